"""Who works in a cell gets short turns on the processor, and nothing else is changed for him."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
from concurrent.futures import ThreadPoolExecutor

import pytest

from services.bus.turns import TURN_NS, ask_for_short_turns

ATTR = struct.Struct("=IIQiIQQQ")
SCHED_GETATTR = {"x86_64": 315, "aarch64": 275}


def read() -> tuple[int, int, int]:
    """Return policy, nice and turn [ns] of this thread as the system has them; turns are 0 where it has none."""
    attr = ctypes.create_string_buffer(ATTR.size)
    assert ctypes.CDLL(None).syscall(SCHED_GETATTR[platform.machine()], 0, attr, ATTR.size, 0) == 0
    _, policy, _, nice, _, turn_ns, _, _ = ATTR.unpack(attr.raw)
    return policy, nice, turn_ns


def test_a_thread_and_those_that_it_starts_get_short_turns_and_are_as_nice_as_before() -> None:
    def asked() -> tuple[bool, tuple[int, int, int], tuple[int, int, int]]:
        taken = ask_for_short_turns()
        with ThreadPoolExecutor(1) as later:
            return taken, read(), later.submit(read).result()

    policy, nice, before_ns = read()
    if before_ns == 0:
        pytest.skip(f"Linux {platform.release()} has turns of one length for all: 6.12 is the first with others")
    with ThreadPoolExecutor(1) as own:  # a thread of its own, so that the other tests run as they did
        taken, mine, of_its_threads = own.submit(asked).result()
    assert taken
    assert mine == of_its_threads == (policy, nice, TURN_NS)
    assert before_ns > TURN_NS


def test_whoever_has_another_policy_keeps_it() -> None:
    def asked() -> tuple[bool, int]:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        return ask_for_short_turns(), os.sched_getscheduler(0)

    with ThreadPoolExecutor(1) as own:
        assert own.submit(asked).result() == (False, os.SCHED_BATCH)
