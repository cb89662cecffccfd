"""What is felt as one array, with its torque referred to the peg's tip. Pure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.wire.messages import Observation


def tip_wrench(felt: Observation, lever_m: float, torque_per_m: float) -> NDArray[np.float64]:
    """Return force [N] and torque about the tip, times ``torque_per_m``, shape (6,), in the tool frame.

    ``lever_m`` is how far the tip is ahead of the sensor. A load aside at the tip has no torque then.
    """
    fx, fy, fz = felt.force_n
    tx, ty, tz = felt.torque_nm
    about = (tx + lever_m * fy, ty - lever_m * fx, tz)
    return np.array([fx, fy, fz, *(torque_per_m * component for component in about)])
