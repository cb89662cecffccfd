"""Keys of a definition about the sensor: how it is read, what hangs on it, how its zero drifts, and what was measured.

``tool`` and ``drift`` are how the simulated cell is; a real one is as it is. ``calibration`` is what ``treenail tare``
measured, of either: all that is done to a sample goes by it (docs/forces.md).
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from services.wire.definition_base import Checked
from services.wire.message_base import MOST_SAMPLES

CentreMm = Annotated[float, Meta(ge=-1000, le=1000)]
Direction = Annotated[float, Meta(ge=-1, le=1)]
SmallForce = Annotated[float, Meta(ge=0, le=100)]


class Sensor(Checked, frozen=True, kw_only=True):
    """How the force/torque sensor is read: in counts of 1/16384 of its full scale or not, and how many samples."""

    full_scale_n: Annotated[int, Meta(ge=0, le=32767)] = 0
    """Full scale of each force component [N]; 0, with the other, for readings that are not rounded."""
    full_scale_dnm: Annotated[int, Meta(ge=0, le=32767)] = 0
    """Full scale of each torque component [0.1 N m], the metric unit of a JR3 receiver."""
    window: Annotated[int, Meta(ge=1, le=MOST_SAMPLES)] = 1
    """Samples whose mean is what is felt after a motion: the first so many once it has ended (docs/forces.md)."""
    rate_hz: Annotated[int, Meta(ge=0, le=100000)] = 0
    """Samples a second that the sensor has to give, to within 5 %; 0 for as many as it gives."""
    filter_hz: Annotated[float, Meta(ge=0, le=10000)] = 0.0
    """Cut-off of the low-pass that samples went through, 31.25 of a JR3's filter 3; 0: none. A real one is not set."""
    tare_samples: Annotated[int, Meta(ge=0, le=MOST_SAMPLES)] = 0
    """Samples at the start of each episode, in the air, whose mean becomes the zero of the episode; 0 for no tare."""
    tare_step_n: SmallForce = 1.0
    """Most that a zero may differ from that of the episode before; of a torque so much times the sensor's height."""
    tare_most_n: SmallForce = 5.0
    """Most that a zero may differ from the calibration's."""
    contact_sigmas: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Contact counts from so many standard deviations of what is felt, at least from ``limits.contact_force_n``."""


class Tool(Checked, frozen=True, kw_only=True):
    """What hangs on the simulated cell's sensor, and where down is: gravity that the sensor feels."""

    mass_kg: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Of peg, gripper and all else that the sensor carries."""
    centre_x_mm: CentreMm = 0.0
    """Centre of gravity in the tool frame."""
    centre_y_mm: CentreMm = 0.0
    """The same along Y."""
    centre_z_mm: CentreMm = 0.0
    """The same along Z; behind the tip it is negative."""
    down_x: Direction = 0.0
    """Where down is, in the hole frame; only the direction counts."""
    down_y: Direction = 0.0
    """The same along Y."""
    down_z: Direction = 1.0
    """The same along Z: 1, with the others 0, for a hole that is open to the top."""


class Drift(Checked, frozen=True, kw_only=True):
    """How the zero of the simulated cell's sensor wanders; drawn for each run, component by component."""

    offset_n: SmallForce = 0.0
    """Standard deviation of the zero of each force component when a run begins."""
    offset_nm: SmallForce = 0.0
    """The same of each torque component."""
    walk_n: SmallForce = 0.0
    """Standard deviation of how far the zero of each force component goes from one episode to the next."""
    walk_nm: SmallForce = 0.0
    """The same of each torque component."""
    ramp_n: SmallForce = 0.0
    """How far it goes in 1000 motions of an episode, in a direction drawn for the run."""
    ramp_nm: SmallForce = 0.0
    """The same of the torque."""


class Calibration(Checked, frozen=True, kw_only=True):
    """What ``treenail tare`` measured of sensor and tool, in the air; without noise there is no calibration."""

    sigma_n: SmallForce = 0.0
    """Standard deviation of each force component of a single sample; 0 for no calibration."""
    sigma_nm: SmallForce = 0.0
    """The same of each torque component."""
    weight_x_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """Weight of the tool, as a force in the hole frame."""
    weight_y_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same along Y."""
    weight_z_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same along Z."""
    centre_x_mm: CentreMm = 0.0
    """Centre of gravity along the sensor's axes, from the sensor's point on."""
    centre_y_mm: CentreMm = 0.0
    """The same along Y."""
    centre_z_mm: CentreMm = 0.0
    """The same along Z; towards the tip it is positive."""
    zero_fx_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """What the sensor shows without any load."""
    zero_fy_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same along Y."""
    zero_fz_n: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same along Z."""
    zero_tx_nm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same about X."""
    zero_ty_nm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same about Y."""
    zero_tz_nm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """The same about Z."""
    residual_n: SmallForce = 0.0
    """What the fit left unexplained of the forces, root mean square over the poses."""
    residual_nm: SmallForce = 0.0
    """The same of the torques."""

    @property
    def made(self) -> bool:
        """Whether there is one."""
        return self.sigma_n > 0.0
