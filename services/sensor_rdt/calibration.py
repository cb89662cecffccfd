"""What a count is worth: from the box's own page, or said. Pure.

The page is ``/netftapi2.xml``. What is not understood is refused: a wrong unit is a wrong force.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

from services.sensor_rdt.errors import CalibrationError
from services.wire.messages import Force, Torque

_POUND_N, _INCH_M, _KILOPOND_N = 4.4482216152605, 0.0254, 9.80665
FORCE_UNITS = {
    "n": 1.0,
    "kn": 1000.0,
    "lbf": _POUND_N,
    "lb": _POUND_N,
    "klbf": 1000.0 * _POUND_N,
    "kg": _KILOPOND_N,
    "kgf": _KILOPOND_N,
    "g": _KILOPOND_N / 1000.0,
}
"""Newton in one, by name in small letters."""
TORQUE_UNITS = {
    "nm": 1.0,
    "nmm": 0.001,
    "knm": 1000.0,
    "lbfin": _POUND_N * _INCH_M,
    "lbfft": _POUND_N * 12.0 * _INCH_M,
    "kgcm": _KILOPOND_N / 100.0,
    "kgfcm": _KILOPOND_N / 100.0,
    "kgm": _KILOPOND_N,
}
"""Newton metre in one, by name in small letters without what stands between."""
_MOST_COUNTS = 1e12
LARGEST_PAGE = 1 << 18


@dataclass(frozen=True)
class Calibration:
    """The scale of one sensor."""

    counts_per_n: float
    counts_per_nm: float
    serial: str = ""
    rate_hz: float | None = None
    """Of the stream, as far as the page says."""

    def read(self, counts: tuple[int, ...]) -> tuple[Force, Torque]:
        """Return force [N] and torque [N m] that six counts stand for."""
        fx, fy, fz, tx, ty, tz = counts
        force, torque = self.counts_per_n, self.counts_per_nm
        return (fx / force, fy / force, fz / force), (tx / torque, ty / torque, tz / torque)


def said(counts_per_force: float, counts_per_torque: float, force_unit: str, torque_unit: str) -> Calibration:
    """Return the calibration in numbers per unit. Raises CalibrationError."""
    return _made(counts_per_force, counts_per_torque, force_unit, torque_unit, "", None)


def from_page(page: bytes) -> Calibration:
    """Return the calibration that a box's page gives. Raises CalibrationError."""
    if len(page) > LARGEST_PAGE:
        raise CalibrationError(f"calibration: expected a page of at most {LARGEST_PAGE} bytes, got more")
    try:
        tree = ElementTree.fromstring(page)
    except ElementTree.ParseError as error:
        raise CalibrationError(f"calibration: expected the box's page to be XML, it is not: {error}") from None
    texts = {element.tag.lower(): (element.text or "").strip() for element in tree.iter()}
    rate = texts.get("comrdtrate", "")
    return _made(
        _number(texts, "cfgcpf"),
        _number(texts, "cfgcpt"),
        texts.get("scfgfu", ""),
        texts.get("scfgtu", ""),
        texts.get("setserial") or texts.get("calsn", ""),
        float(rate) if re.fullmatch(r"\d{1,5}", rate) and float(rate) > 0 else None,
    )


def _made(
    per_force: float, per_torque: float, force_unit: str, torque_unit: str, serial: str, rate_hz: float | None
) -> Calibration:
    newton = FORCE_UNITS.get(force_unit.strip().lower())
    if newton is None:
        raise CalibrationError(
            f"calibration: expected a unit of force in {', '.join(FORCE_UNITS)}, got {force_unit[:20]!r}"
        )
    newton_metre = TORQUE_UNITS.get(re.sub(r"[^a-z]", "", torque_unit.lower()))
    if newton_metre is None:
        expected = f"expected a unit of torque in {', '.join(TORQUE_UNITS)}"
        raise CalibrationError(f"calibration: {expected}, got {torque_unit[:20]!r}")
    for name, counts in (("force", per_force), ("torque", per_torque)):
        if not 0.0 < counts <= _MOST_COUNTS:  # what is no number never passes
            raise CalibrationError(f"calibration: expected counts per unit of {name} above 0, got {counts}")
    return Calibration(per_force / newton, per_torque / newton_metre, serial[:40], rate_hz)


def _number(texts: dict[str, str], name: str) -> float:
    try:
        return float(texts[name])
    except (KeyError, ValueError):
        raise CalibrationError(
            f"calibration: expected a number as {name} on the box's page, got {texts.get(name, 'none')[:40]!r}; say "
            "--counts-per-force and --counts-per-torque"
        ) from None
