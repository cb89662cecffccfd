"""``bench link``: every figure is there, and what it measured is what it was asked for. No test looks at speed."""

from __future__ import annotations

import json

import pytest

from experiments.bench.__main__ import main
from experiments.bench.link_dialogue import MODES, Dialogue, Mode
from services.wire.actions import Increment


def test_the_report_has_all_figures(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["link", "--messages", "100", "--moves", "3", "--rounds", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    results = found["results"]
    assert (found["bench"], results["rounds"], results["messages"], results["moves"]) == ("link", 2, 100, 3)
    assert set(results["ddcmp"]) == {"clean", "bit_errors_1e-4"}
    figures = [results["dialogue"][mode]["moves_per_s"] for mode in MODES]
    for line in results["ddcmp"].values():
        figures += [line[name] for name in line if name.endswith("_per_s")]
        assert 0 < line["at_9600_baud_payload_share"] < 1
    assert len(figures) == 2 + 2 * 3
    assert all(0 < one["min"] <= one["median"] <= one["max"] for one in figures)
    assert results["ddcmp"]["clean"]["sent_again_share"] == 0
    assert results["ddcmp"]["bit_errors_1e-4"]["sent_again_share"] > 0


@pytest.mark.parametrize("mode", MODES)
def test_a_dialogue_moves_the_emulated_arm(mode: Mode) -> None:
    dialogue = Dialogue(mode)
    before, motions = dialogue.controller.arm.place.copy(), dialogue.controller.motions
    increment = Increment(dx_mm=0.2, dz_mm=-0.4, ry_deg=0.3)
    assert dialogue.move(increment, 1) == increment
    assert dialogue.controller.motions == motions + 1
    moved = dialogue.controller.arm.place
    # The tool's x axis is the base's reversed, its z axis points down.
    assert moved[:3, 3] - before[:3, 3] == pytest.approx([-0.2, 0.0, 0.4], abs=1e-6)


def test_both_modes_say_the_same_to_the_controller() -> None:
    heard = []
    for mode in MODES:
        dialogue = Dialogue(mode)
        for step in range(1, 6):
            dialogue.move(Increment(dx_mm=0.1 * step), step)
        heard.append(dialogue.controller.heard)
    assert heard[0] == heard[1]
    assert sum(line.startswith("DO MOVE HERE:TRANS(") for line in heard[0]) == 6, "the start's offset and five moves"
