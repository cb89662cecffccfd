"""A skill into a cell's store, and out of the way again; and waiting until the task has taken note."""

from __future__ import annotations

import time
from collections.abc import Callable

import zenoh

from services.cell.client import Client
from services.rules.skill import NamedSkill
from services.wire.codec import encode, encoding_of
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError
from services.wire.keys import CHOSEN_SKILL, EXPERIMENT, LATEST, SKILL, name_of
from services.wire.messages import Experiment, Skill

KEPT_WITHIN_S = 5.0
"""How long the store gets to give back what it was given."""
RETRY_S = 0.1


def give(
    client: Client,
    skill: NamedSkill,
    mind: Callable[[], None] = lambda: None,
    within_s: float = KEPT_WITHIN_S,
) -> None:
    """Put a skill into the store, first under its name and then as the one to begin with; read both back.

    ``mind`` is called while waiting. Raises CellError when the store does not confirm it within ``within_s``.
    """
    for name in (skill.sha256, LATEST):
        client.rights.need("put", name_of(SKILL, sha256=name))
    payload = encode(skill.skill)
    for name in (skill.sha256, LATEST):
        deadline = time.monotonic() + within_s
        while not _kept(client, name, payload):
            mind()
            if time.monotonic() > deadline:
                here = ", ".join(client.alive()) or "nobody"
                raise CellError(
                    f"store: expected it to keep {name_of(SKILL, sha256=name[:12])} within {within_s:g} s, it did not; "
                    f"alive in cell {client.keys.cell!r}: {here}"
                )
            time.sleep(RETRY_S)


def forget(client: Client) -> bool:
    """Let the next run begin with nothing learnt; False when it would have anyway. Raises CellError."""
    client.rights.need("delete", CHOSEN_SKILL)
    deadline, had = time.monotonic() + KEPT_WITHIN_S, False
    while True:
        samples, _ = client.replies(CHOSEN_SKILL, 5.0)
        if not samples and "store" in client.alive():
            return had
        if time.monotonic() > deadline:
            got = "has the skill still" if samples else "does not answer"
            raise CellError(f"store: expected it to forget {CHOSEN_SKILL} within {KEPT_WITHIN_S:g} s, it {got}")
        if samples:
            had = True
            client.session.delete(client.keys.skill(LATEST))
        time.sleep(RETRY_S)


def running(client: Client) -> Experiment | None:
    """Return what the cell's task works on, or None when it does not answer. Raises ContractError."""
    try:
        return client.ask(EXPERIMENT, Experiment)
    except (NoAnswerError, RefusedError):
        return None


def taken(client: Client, sha256: str | None, within_s: float) -> Experiment:
    """Wait until the task works on a run that began with a skill, or with None; return what it says.

    Raises CellError when it does not within ``within_s``: it changes the run between episodes.
    """
    deadline, last = time.monotonic() + within_s, "it did not answer"
    while True:
        try:
            experiment = running(client)
        except ContractError as error:
            raise CellError(f"task: {error}") from error
        if experiment is not None and experiment.skill_sha256 == sha256:
            return experiment
        if experiment is not None:
            last = f"it still works on run {experiment.run} ({experiment.phase})"
        if time.monotonic() > deadline:
            wanted = "nothing learnt" if sha256 is None else f"skill {sha256[:12]}"
            raise CellError(
                f"task: expected it to begin a run with {wanted} within {within_s:g} s, {last}; "
                "the store has taken note, so the task will between two episodes"
            )
        time.sleep(RETRY_S)


def beginning(experiment: Experiment) -> str:
    """Return in words what a run began with and how far it is: true of a new one and of one taken up again."""
    skill = "nothing learnt" if experiment.skill_sha256 is None else f"skill {experiment.skill_sha256[:12]}"
    done = f"{experiment.episodes_done} of {experiment.episodes} episodes done"
    return f"run {experiment.run} began with {skill}: {done}"


def _kept(client: Client, name: str, payload: bytes) -> bool:
    """Put a skill's bytes under a name and return whether the store gives them back."""
    client.session.put(
        client.keys.skill(name),
        payload,
        encoding=encoding_of(Skill),
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
    samples, _ = client.replies(name_of(SKILL, sha256=name), 5.0)
    return any(sample.payload.to_bytes() == payload for sample in samples)
