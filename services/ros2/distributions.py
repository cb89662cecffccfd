"""What differs between the distributions of ROS 2 in what rmw_zenoh writes. Pure.

Sources: ros2/rmw_zenoh, the change logs of its branches and attachment_helpers.cpp, qos.cpp of each.
"""

from __future__ import annotations

from typing import NamedTuple


class Distribution(NamedTuple):
    """One distribution."""

    name: str
    definitions: str
    """What rosbags calls its message definitions."""
    named: bool = False
    """Whether an attachment names its fields: 77 bytes, else 33. Whoever expects the other one may abort."""
    says_durability: bool = False
    """Whether a token says "volatile": when this was not yet what is meant by saying nothing."""


_ALL = (
    Distribution("jazzy", "ros2_jazzy"),
    Distribution("jazzy-0.2.3", "ros2_jazzy", named=True, says_durability=True),
    Distribution("kilted", "ros2_kilted"),
    Distribution("lyrical", "ros2_lyrical"),
    Distribution("rolling", "latest"),
)
DISTRIBUTIONS = {one.name: one for one in _ALL}
"""By name; ``jazzy-0.2.3`` is Jazzy with rmw_zenoh_cpp 0.2.3 and older, of before April 2025."""
USUAL = "jazzy"
MOST_DOMAIN = 232
NO_HASH = "TypeHashNotSupported"
"""What stands for a type's hash where a distribution has none: Humble."""
