"""What a sensor's samples come to: the load on the peg by its surroundings alone, fit to learn from. Pure.

    samples of one window -> their mean -> less the zero -> less the tool's weight as the tool is turned now -> felt

The zero is taken in the air at the start of each episode. Whether that really was air, noise and the zeros before it
tell: one that is too noisy, too far from the zero of the episode before or too far from the calibration's is refused,
and nothing moves on. How the tool is turned is what the arm was told; how heavy it is, ``treenail tare`` measured.

The same for every sensor and for the simulator's, for the task and for the guard beside the robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from services.rules.window import Load, mean, mean_load
from services.rules.workspace import UPRIGHT, Matrix, Vector, product, rotation
from services.wire.actions import Increment
from services.wire.definition import Calibration, Definition
from services.wire.errors import TreenailError
from services.wire.messages import Force, FtPacket, Home, Torque, Zero

NOISIER = 2.0
"""How many times the calibration's noise a tare may show: more of it is another sensor, or not still air."""
FEWEST = 16
"""Samples that noise can be judged by: of so many, twice of it comes by chance once in a thousand million."""
G_M_PER_S2 = 9.80665
SHORTEST_LEVER_M = 0.05
"""Least lever by which a limit of a force is one of a torque."""
_ALONG = 0.9
"""Cosine of the angle up to which a load counts as one along the weight."""
_NOTHING: Load = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class TareError(TreenailError):
    """What was felt at the start of an episode cannot be a zero."""


class Forces:
    """The forces of one run: a zero for each episode, and the tool's weight as it is turned."""

    def __init__(self, definition: Definition) -> None:
        self._sensor, self._calibration = definition.sensor, definition.calibration
        self.tares = definition.sensor.tare_samples > 0
        """Whether each episode begins with a tare."""
        self.changes_nothing = definition.sensor.window == 1 and not self.tares and not definition.calibration.made
        """Whether the newest sample is what is felt."""
        self._most_lever_m = max(SHORTEST_LEVER_M, definition.wrist.sensor_height_mm * 1e-3)
        wrist = definition.wrist
        self._mount = rotation(wrist.sensor_rx_deg, wrist.sensor_ry_deg, wrist.sensor_rz_deg)
        self._weight = Weight(definition.calibration)
        self._home_turn: Matrix = UPRIGHT
        self._turn: Matrix = UPRIGHT
        self._zero: Load = calibrated_zero(definition.calibration)

    def home(self, home: Home) -> None:
        """Take note that the tool stands at a start pose."""
        self._turn = rotation(home.rx_deg, home.ry_deg, home.rz_deg)
        self._home_turn = self._seen_from(self._turn)

    def moved(self, increment: Increment) -> None:
        """Take note of a motion that was made."""
        if increment[3:] != (0.0, 0.0, 0.0):
            self._turn = product(self._turn, rotation(*increment[3:]))

    def tare(self, packet: FtPacket, step: int = 0, *, follows: bool = False) -> Zero:
        """Take samples at the start pose, in the air, as the zero from a step on.

        With ``follows`` it has to be near the zero before it, of the same sensor that was not switched off meanwhile.
        Raises TareError for what cannot be a zero; it stays what it was then.
        """
        force_n, torque_nm = mean_load(packet)
        weight = self._weight.at(self._home_turn)
        zero = (less(force_n, weight[0]), less(torque_nm, weight[1]))
        sigma_n, sigma_nm = spread(packet.force_n), spread(packet.torque_nm)
        self._check_noise(len(packet.force_n), sigma_n, sigma_nm)
        if follows:
            self._check_zero(zero, self._zero, self._sensor.tare_step_n, "that of the tare before")
        calibrated = calibrated_zero(self._calibration)
        self._check_zero(zero, calibrated, self._sensor.tare_most_n, "that of the calibration")
        self._zero = zero
        return Zero(step=step, force_n=zero[0], torque_nm=zero[1], sigma_n=sigma_n)

    def felt(self, packet: FtPacket) -> Load:
        """Return force [N] and torque [N m] that the surroundings do to the peg, by the samples of one window."""
        newest = (packet.force_n[-1], packet.torque_nm[-1])
        return self.of(newest if self._sensor.window == 1 else mean_load(packet))

    def of(self, load: Load) -> Load:
        """Return what a load that the sensor shows comes to, without zero and weight."""
        if not self.tares and not self._calibration.made:
            return load
        weight = self._weight.at(self._seen_from(self._turn))
        return less(less(load[0], self._zero[0]), weight[0]), less(less(load[1], self._zero[1]), weight[1])

    def _seen_from(self, turn: Matrix) -> Matrix:
        """Return how the sensor is turned in the hole frame when the tool is turned so."""
        return turn if self._mount == UPRIGHT else product(turn, self._mount)

    def _check_noise(self, samples: int, sigma_n: float, sigma_nm: float) -> None:
        calibration = self._calibration
        pairs = ((sigma_n, calibration.sigma_n, "N"), (sigma_nm, calibration.sigma_nm, "N m"))
        for got, calibrated, unit in pairs:
            if samples >= FEWEST and calibrated > 0.0 and got > NOISIER * calibrated:
                expected = f"expected noise of at most {NOISIER:g} times the {calibrated:.3g} {unit} of the calibration"
                raise TareError(f"tare: {expected}, got {got:.3g} {unit}; is something moving or loose?")

    def _check_zero(self, zero: Load, other: Load, most_n: float, whose: str) -> None:
        """Raise TareError for a zero that is too far from another one."""
        force_n, torque_nm = less(zero[0], other[0]), less(zero[1], other[1])
        off_n, off_nm, most_nm = math.hypot(*force_n), math.hypot(*torque_nm), most_n * self._most_lever_m
        if off_n > most_n:
            expected = f"expected a zero within {most_n:g} N of {whose}"
            raise TareError(f"tare: {expected}, got {off_n:.2f} N more; {self._guess(force_n, off_n)}")
        if off_nm > most_nm:
            expected = f"expected a zero within {most_nm:.3g} N m of {whose}"
            raise TareError(f"tare: {expected}, got {off_nm:.3g} N m more; is the tool in the air?")

    def _guess(self, force_n: Force, off_n: float) -> str:
        """Return what may be the reason of a zero that is off by a force."""
        down = self._weight.at(self._home_turn)[0]
        size_n = math.hypot(*down)
        along_n = sum(a * b for a, b in zip(force_n, down, strict=True)) / size_n if size_n else 0.0
        if abs(along_n) > _ALONG * off_n:
            kind = "heavier" if along_n > 0 else "lighter"
            return f"is the tool {abs(along_n) / G_M_PER_S2:.2f} kg {kind} than calibrated, or pressed on something?"
        return "is the tool in the air, and the sensor the one that was calibrated?"


class Weight:
    """The tool's weight, as a calibration has it: along the sensor's axes, about the sensor's point."""

    def __init__(self, calibration: Calibration) -> None:
        self._hole_n: Vector = (calibration.weight_x_n, calibration.weight_y_n, calibration.weight_z_n)
        self._none = self._hole_n == (0.0, 0.0, 0.0)
        centre_mm = (calibration.centre_x_mm, calibration.centre_y_mm, calibration.centre_z_mm)
        self._arm_m: Vector = (centre_mm[0] * 1e-3, centre_mm[1] * 1e-3, centre_mm[2] * 1e-3)

    def at(self, turn: Matrix) -> Load:
        """Return the weight when the sensor's axes are the columns of ``turn`` in the hole frame."""
        if self._none:
            return _NOTHING
        a, b, c = turn
        gx, gy, gz = self._hole_n
        wx, wy, wz = (a[i] * gx + b[i] * gy + c[i] * gz for i in range(3))
        x, y, z = self._arm_m
        return (wx, wy, wz), (y * wz - z * wy, z * wx - x * wz, x * wy - y * wx)


def calibrated_zero(calibration: Calibration) -> Load:
    """Return what the sensor showed without any load when it was calibrated; nothing without a calibration."""
    force_n: Force = (calibration.zero_fx_n, calibration.zero_fy_n, calibration.zero_fz_n)
    torque_nm: Torque = (calibration.zero_tx_nm, calibration.zero_ty_nm, calibration.zero_tz_nm)
    return force_n, torque_nm


def less(one: Force, other: Force) -> Force:
    """Return the difference of two forces or torques, shape (3,)."""
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def spread(samples: Sequence[Force]) -> float:
    """Return the standard deviation of a component over two or more samples, all three alike; 0 of a single one."""
    count = len(samples)
    if count < 2:
        return 0.0
    at = mean(samples)
    squares = math.fsum((value - middle) ** 2 for one in samples for value, middle in zip(one, at, strict=True))
    return math.sqrt(squares / (3 * (count - 1)))
