"""A cell whose learner remembers within an episode where it was: killed in the middle of one, it loses nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

FELT = (
    'learner={kind="felt", follow_fade=0.1, follow_least=0.5, revisit=2.0}',
    'policy={kind="thompson", width=2.0}',
    "shaping.gamma=1.0",
    "shaping.price_per_n=2.0",
)
EPISODES = 24


def test_an_agent_that_is_killed_within_an_episode_remembers_where_it_was(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    settings = (word for item in FELT for word in ("--set", item))
    process = up(tmp_path / "A", EPISODES, *settings)
    endpoint = endpoint_of(tmp_path / "A")
    for victim, actions in (("agent", 7), ("agent", 13), ("task", 5), ("agent", 31)):
        kill_after(process, endpoint, victim, actions)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert process.out.count("agent was killed by SIGKILL; starting it again") == 3
    undisturbed = reference(EPISODES, 1, *FELT)
    assert digests_in(tmp_path / "A") == undisturbed
    assert undisturbed != reference(EPISODES, 1, FELT[0].replace("revisit=2.0", "revisit=0.0"), *FELT[1:])
