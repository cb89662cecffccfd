"""A whole cell with certificates: it ends as one without, whatever is killed in it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.bus.session import open_client
from services.cell.certificates import certify
from services.wire.keys import ACTION, Keys

EPISODES = 24


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("house") / "certs"
    certify(folder, [], 365)
    return folder


@pytest.fixture
def after_secured_actions(certs: Path, wait_until: Callable[..., None]) -> Callable[[str, int], None]:
    """Waits, as a guest, until the agent of a cell has acted so often."""

    def wait(endpoint: str, count: int) -> None:
        seen: list[object] = []
        session = open_client([endpoint], 30.0, certs=certs / "guest")
        try:
            subscriber = session.declare_subscriber(Keys("a").of(ACTION), seen.append)
            wait_until(f"{count} actions", lambda: len(seen) >= count)
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        finally:
            session.close()  # type: ignore[no-untyped-call]

    return wait


@pytest.mark.parametrize("victim", ["agent", "router"])
def test_a_process_killed_in_a_secured_cell_changes_nothing(
    up: Callable[..., Any],
    certs: Path,
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    after_secured_actions: Callable[[str, int], None],
    wait_until: Callable[..., None],
    tmp_path: Path,
    victim: str,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES, "--certs", str(certs))
    after_secured_actions(endpoint_of(out), 100)
    wait_until(f"{victim} runs", lambda: victim in process.children())
    os.kill(process.children()[victim], signal.SIGKILL)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert f"{victim} was killed by SIGKILL; starting it again" in process.out
    assert digests_in(out) == reference(EPISODES)


def test_a_folder_without_all_certificates_is_one_line_and_nothing_is_started(
    up: Callable[..., Any], tmp_path: Path
) -> None:
    certify(tmp_path / "some", [], 365, ["router", "store", "task", "operator"])
    process = up(tmp_path / "A", 3, "--certs", str(tmp_path / "some"))
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert f"{tmp_path}/some/classifier/ca.pem: expected what treenail certs makes" in line
    assert not (tmp_path / "A").exists()
