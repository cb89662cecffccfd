"""Handing work to a Dask cluster: what goes wrong is one line; what a cluster does is in tests/system."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.lab import cluster
from treenail.commands import leaderboard as command


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x", "tcp://127.0.0.1:port"])
def test_no_scheduler_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    words = ["--tasks", "suite-round", "--methods", "rule", "--seeds", "100", "--out", str(tmp_path)]
    assert command.main([*words, "--on", address]) == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith(f"treenail leaderboard: --on: expected a Dask scheduler at {address}, got none")
    assert not list((tmp_path / "runs").glob("*.json"))


def test_here_and_there_is_not_both(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["--on", "tcp://127.0.0.1:9", "--jobs", "2"])
    assert "not allowed with" in capsys.readouterr().err
