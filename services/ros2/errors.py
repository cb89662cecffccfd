"""What can be wrong with what ROS 2 says."""

from __future__ import annotations

from services.wire.errors import TreenailError


class Ros2Error(TreenailError):
    """Something of ROS 2 that cannot be used."""


class BadNameError(Ros2Error):
    """A name, a topic or a domain that ROS 2 does not have."""


class PeerError(Ros2Error):
    """What a peer says in another type, of another distribution or in another layout; it is not read."""


class MessageError(Ros2Error):
    """A message that is not what its type says."""


class SampleError(Ros2Error):
    """A sample that cannot be taken for what is so now."""


class FrameError(SampleError):
    """A sample in another frame than was said."""


class ClockError(SampleError):
    """The clock of a peer has jumped."""


class SilentError(Ros2Error):
    """Nothing comes that could be used."""
