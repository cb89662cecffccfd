"""``treenail tare``: what it measures is written whole, and what it is given in a live cell is looked at."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.rules.calibration import CalibrationError
from services.rules.command_line import Parser
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from services.wire.messages import FtPacket
from treenail.commands.tare import act, add_arguments, collect

NONE = ((0.0, 0.0, 0.0),)


def test_a_simulated_tool_is_measured_and_its_definition_can_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The definition asks for a tare, which it cannot have before there is a calibration."""
    bare, out = tmp_path / "bare.toml", tmp_path / "mine.toml"
    bare.write_text(
        'name = "mine"\n[noise]\nforce_n = 0.5\ntorque_nm = 0.03\n[tool]\nmass_kg = 0.8\ncentre_z_mm = -40.0\n'
        "[sensor]\nwindow = 64\ntare_samples = 128\ncontact_sigmas = 5.0\n[limits]\nhard_force_n = 30.0\n"
    )
    with pytest.raises(TreenailError, match="expected 0 without a calibration"):
        load(str(bare))
    parser = Parser(prog="treenail tare")
    add_arguments(parser)
    act(parser.parse_args([str(bare), "--simulated", "--out", str(out)]))
    made, said = load(str(out)), capsys.readouterr().out
    assert made.calibration.weight_z_n == pytest.approx(0.8 * 9.80665, abs=0.1)
    assert made.sensor.tare_samples == 128
    assert said.startswith("tool        0.799 kg (+-0.002), weight ")
    assert "residual    " in said
    assert "felt        noise 0.0" in said
    assert max(map(len, said.splitlines())) <= 100


def test_a_filter_has_come_to_rest_in_each_pose(tmp_path: Path) -> None:
    """One of 0.5 Hz would still be on its way for most of the 2000 samples."""
    bare, out = tmp_path / "bare.toml", tmp_path / "mine.toml"
    bare.write_text(
        'name = "mine"\n[noise]\nforce_n = 0.5\ntorque_nm = 0.03\n[tool]\nmass_kg = 0.8\ncentre_z_mm = -40.0\n'
        "[sensor]\nrate_hz = 1000\nfilter_hz = 0.5\n[limits]\nhard_force_n = 200.0\n"
    )
    parser = Parser(prog="treenail tare")
    add_arguments(parser)
    act(parser.parse_args([str(bare), "--simulated", "--out", str(out)]))
    made = load(str(out)).calibration
    assert made.weight_z_n == pytest.approx(0.8 * 9.80665, abs=0.1)
    assert made.residual_n < 0.03


def packets(*numbers: int, status: int = 0) -> list[FtPacket]:
    return [
        FtPacket(sequence=number, t_ns=number, period_ns=1, status=status, force_n=NONE, torque_nm=NONE)
        for number in numbers
    ]


def test_samples_are_taken_once() -> None:
    waiting = iter(packets(1, 2, 2, 3, 1, 4))
    forces, torques = collect(lambda _: next(waiting), 4)
    assert (len(forces), len(torques)) == (4, 4)
    assert next(waiting, None) is None


def test_a_sensor_that_falls_silent_is_named() -> None:
    waiting = iter([*packets(1, 2), None])
    with pytest.raises(
        CalibrationError, match="expected 4 samples, got 2 and then none for 5 s; does a sensor publish"
    ):
        collect(lambda _: next(waiting), 4)


@pytest.mark.parametrize(("status", "why"), [(1, "saturated"), (4, "lost"), (8, "changed"), (16, "not yet zeroed")])
def test_samples_that_say_that_they_are_none_are_not_taken(status: int, why: str) -> None:
    waiting = iter([*packets(1), *packets(2, status=status)])
    with pytest.raises(CalibrationError, match=rf"expected samples that can be used, got status {status} \({why}\)"):
        collect(lambda _: next(waiting), 4)
