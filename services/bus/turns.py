"""Short turns on the processor: who wakes for a message gets his turn soon, and has it for less long.

Linux gives each thread that is ready a turn of some milliseconds (on two cores 1.4), and who wakes meanwhile may wait
for the end of somebody else's: a decision passes ten threads, and so does a question. From version 6.12 on a thread may
ask for shorter turns, which come sooner. It takes no right, because nobody gets more of the processor by that.

See docs/decisions/0039-short-turns.md.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct

TURN_NS = 100_000
"""The shortest that there is."""
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
"""Number of the system call, for which the C library of Debian 12 has no name."""
_ATTR = struct.Struct("=IIQiIQQQ")
"""``struct sched_attr``: size, policy, flags, nice, priority, runtime, deadline, period."""


def ask_for_short_turns() -> bool:
    """Ask for short turns for this thread and all that it starts; return whether the system took it.

    A process that somebody has given another policy than the usual one keeps it.
    """
    call = _SCHED_SETATTR.get(platform.machine())
    if call is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attr = ctypes.create_string_buffer(_ATTR.pack(_ATTR.size, os.SCHED_OTHER, 0, nice, 0, TURN_NS, 0, 0))
    # Refused where a container's rules forbid the call; older systems take it and do as before.
    return int(ctypes.CDLL(None).syscall(call, 0, attr, 0)) == 0
