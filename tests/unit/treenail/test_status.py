"""What ``treenail status`` prints: lines that fit, and what all say alike said once."""

from __future__ import annotations

import io

import pytest

from services.cell.terminal import console
from services.wire.codec import contract_sha256
from services.wire.messages import Alive
from tests.unit.heartbeats import alive
from treenail.commands import status
from treenail.commands.status import Row, Seen

NAMES = ("agent", "classifier", "robot_link", "router", "sensor_jr3", "sim", "store", "task", "viewer")


def here(name: str, **changed: object) -> Alive:
    usual: dict[str, object] = {
        "version": "0.1.0",
        "contract_sha256": contract_sha256(),
        "host": "cell-pc.lab.example",
        "pid": 4_123_456,
        "instance": f"00001764349200123456789-{name}",
        "run": "d2b93e8f7c149588-s0",
        "handled": 12_345_678,
    }
    return alive(name, **usual | changed)


def rows(**changed: dict[str, object]) -> list[Row]:
    answers = {name: here(name, **changed.get(name, {})) for name in NAMES}
    seen = Seen("a", list(NAMES), answers, answers, beats=dict.fromkeys(NAMES, 0.532))
    return [status.row(seen, name, contract_sha256()) for name in seen.names]


def shown(found: list[Row]) -> list[str]:
    file = io.StringIO()
    screen = console(file=file)
    screen.width = 80
    screen.print(status.table("Cell a: chamfered-q-softmax, seed 0, episode 931 of 2000", found))
    return [*file.getvalue().splitlines(), *status.footnotes(found)]


def test_a_service_is_one_line_of_80_columns_and_what_all_say_is_said_once() -> None:
    lines = shown(rows())
    assert all(len(line) <= 80 for line in lines if not line.startswith("all: "))
    for name in NAMES:
        (line,) = (line for line in lines if line.split()[:1] == [name])
        for word in ("running", "0.53 s ago", "12345678", "4123456"):
            assert word in line
    last = lines[-1]
    assert last.startswith("all: run d2b93e8f7c149588-s0, version 0.1.0, contract ")
    assert "version" not in "".join(lines[:-1])


@pytest.mark.parametrize(
    ("field", "value", "column"),
    [("version", "0.2.0", "version"), ("contract_sha256", "0" * 64, "contract"), ("host", "other", "host")],
)
def test_what_differs_has_a_column(field: str, value: str, column: str) -> None:
    lines = shown(rows(agent={field: value}))
    assert column in "".join(lines[:3])
    assert not any(line.startswith("all: ") and f"{column} " in line for line in lines)


def test_what_was_refused_is_told_below() -> None:
    lines = shown(rows(sim={"refused": {"BadPayloadError": 3, "StrangerError": 400}}))
    assert "refused by sim: 3 BadPayloadError, 400 StrangerError" in lines
    (line,) = (line for line in lines if line.split()[:1] == ["sim"])
    assert " 403 " in line


def test_what_all_say_alike_fits_any_width_too() -> None:
    last = shown(rows())[-1]
    for width in (80, 140):
        lines = status.fitted(last, width).splitlines()
        assert all(len(line) <= width for line in lines)
        assert " ".join(line.strip() for line in lines) == last
