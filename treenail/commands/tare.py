"""``treenail tare``: measure a tool's weight and centre of gravity, and noise and zero of the sensor that holds it."""

from __future__ import annotations

import argparse
import os
import queue
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from services.cell import client
from services.rules.calibration import CalibrationError, Fit, Still, Turned, fit, poses, still
from services.rules.command_line import number, whole
from services.rules.window import unusable
from services.wire.definition import Definition
from services.wire.definition_file import check, load
from services.wire.errors import DefinitionError
from services.wire.felt_noise import contact_force_n, felt_sigma_n
from services.wire.keys import FT
from services.wire.messages import Force, FtPacket, Torque
from services.wire.randomness import MAX_SEED

EPILOG = (
    "Six poses in the air, far from everything: the tool straight, and tilted. In each the arm is moved by hand, from "
    "its own panel, and stands still while samples are taken; Enter says that it does. What is measured is written "
    "into a copy of the definition as its table [calibration]; docs/forces.md says what is done with it."
)
SLOWEST_HZ = 50.0
"""Of a sensor that is waited for."""
_WAIT_S = 5.0
_TO_BE_MADE = ("calibration.sigma_n=1e-6", "calibration.residual_n=0")
"""A definition may ask for what needs a calibration before there is one."""

Samples = tuple[list[Force], list[Torque]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = EPILOG
    parser.add_argument("experiment", help="name or TOML file of the definition whose sensor and tool these are")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where the calibrated definition goes")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change one key before")
    parser.add_argument("--samples", type=whole(100, 100_000), default=2000, help="in each pose (default: 2000)")
    parser.add_argument(
        "--tilt", type=number(5.0, 90.0), default=20.0, metavar="DEG", help="how far to tilt (default: 20)"
    )
    parser.add_argument("--simulated", action="store_true", help="of the simulated sensor, in this process")
    parser.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="of the simulated sensor")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Measure, print what came out, and write it."""
    definition = load(arguments.experiment, (*arguments.set, *_TO_BE_MADE))
    turned = poses(arguments.tilt)
    if arguments.simulated:
        seen = _simulated(definition, arguments.seed, turned, arguments.samples)
    else:
        seen = _guided(arguments, turned)
    measured = fit(seen, definition)
    calibrated = _with(definition, measured)
    for line in report(measured, calibrated, seen):
        print(line)
    _write(arguments.out, calibrated)
    print(f"written: {arguments.out}")


def report(measured: Fit, definition: Definition, seen: list[Still]) -> list[str]:
    """Return what was measured, in lines."""
    calibration, sensor = measured.calibration, definition.sensor
    centre = ", ".join(f"{getattr(calibration, f'centre_{axis}_mm'):.1f}" for axis in "xyz")
    down = [getattr(calibration, f"weight_{axis}_n") for axis in "xyz"]
    zero = ", ".join(f"{getattr(calibration, f'zero_f{axis}_n'):.2f}" for axis in "xyz")
    unsure = f" (+-{measured.unsure_mm:.1f})" if measured.unsure_mm < 1e3 else ""
    taken = f" and a zero of {sensor.tare_samples}" if sensor.tare_samples else ""
    felt_n, contact_n = felt_sigma_n(definition), contact_force_n(definition)
    mass = f"{measured.mass_kg:.3f} kg (+-{measured.unsure_kg:.3f})"
    return [
        f"tool        {mass}, weight {_numbers(down)} N in the hole frame",
        f"centre      {centre} mm from the sensor's point{unsure}",
        f"zero        {zero} N",
        f"noise       {calibration.sigma_n:.3g} N and {calibration.sigma_nm:.3g} N m a sample",
        f"residual    {calibration.residual_n:.3g} N and {calibration.residual_nm:.3g} N m over {len(seen)} poses",
        f"felt        noise {felt_n:.3g} N (window of {sensor.window}{taken}), contact from {contact_n:.3g} N",
    ]


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def _with(definition: Definition, measured: Fit) -> Definition:
    """Return the definition with its calibration, checked as when it will be read. Raises CalibrationError."""
    fields = msgspec.to_builtins(definition) | {"calibration": msgspec.to_builtins(measured.calibration)}
    try:
        return check(fields, {}, "tare")
    except DefinitionError as error:
        hint = "was the tool in the air and turned as asked for, and is the sensor mounted as the definition says?"
        raise CalibrationError(f"{error}; {hint}") from None


def _simulated(definition: Definition, seed: int, turned: tuple[Turned, ...], samples: int) -> list[Still]:
    from services.sim.pose import Pose
    from services.sim.sensor import SimulatedSensor
    from services.sim.world import NO_LOAD

    sensor, seen = SimulatedSensor(definition, seed), []
    for step, pose in enumerate(turned):
        loads, _ = sensor.samples(NO_LOAD, Pose.from_tilt(0.0, 0.0, 0.0, *pose), 0, step, samples)
        forces, torques = zip(*loads, strict=True)
        seen.append(still(pose, forces, torques))
    return seen


def _guided(arguments: argparse.Namespace, turned: tuple[Turned, ...]) -> list[Still]:
    seen: list[Still] = []
    heard: queue.SimpleQueue[FtPacket] = queue.SimpleQueue()
    with client.client_of(arguments) as cell:
        cell.subscribe(FT, FtPacket, heard.put)
        for number_of, pose in enumerate(turned, start=1):
            asked = f"{number_of}/{len(turned)}: tool in the air and still, turned {pose.rx_deg:g} deg about X and "
            _ask(f"{asked}{pose.ry_deg:g} deg about Y of the hole; Enter when it is: ")
            while not heard.empty():
                heard.get_nowait()
            seen.append(still(pose, *collect(lambda wait_s: _next(heard, wait_s), arguments.samples)))
            print(f"   {_numbers(list(seen[-1].force_n))} N, noise {seen[-1].sigma_n:.3g} N", file=sys.stderr)
    return seen


def collect(following: Callable[[float], FtPacket | None], samples: int) -> Samples:
    """Return so many samples of packets that follow each other; ``following`` waits so long for one [s].

    Raises CalibrationError when too few come, or such that say of themselves that they are none.
    """
    forces: list[Force] = []
    torques: list[Torque] = []
    number_of: int | None = None
    until = time.monotonic() + _WAIT_S + samples / SLOWEST_HZ
    while len(forces) < samples:
        packet = following(min(_WAIT_S, max(0.0, until - time.monotonic())))
        if packet is None:
            got = f"{len(forces)} and then none for {_WAIT_S:g} s"
            raise CalibrationError(f"tare: expected {samples} samples, got {got}; does a sensor publish in this cell?")
        why = unusable(packet.status)
        if why is not None:
            raise CalibrationError(f"tare: expected samples that can be used, got status {packet.status} ({why})")
        if number_of is None or packet.sequence > number_of:
            number_of = packet.sequence
            forces += packet.force_n
            torques += packet.torque_nm
    return forces[:samples], torques[:samples]


def _next(heard: queue.SimpleQueue[FtPacket], wait_s: float) -> FtPacket | None:
    try:
        return heard.get(timeout=wait_s)
    except queue.Empty:
        return None


def _ask(question: str) -> None:
    print(question, end="", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise CalibrationError("tare: expected Enter for each pose, got the end of the input; nothing was written")


def _write(path: Path, definition: Definition) -> None:
    """Write a definition, whole or not at all. Raises CalibrationError."""
    from experiments.lab.result_files import definition_toml

    try:
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
            file.write(definition_toml(definition))
        os.replace(file.name, path)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from None
