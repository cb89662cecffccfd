"""The latch between a stop and the next motion."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.hold import MOST_FAILED, Hold, PauseError, StoppedError
from services.wire.messages import Resume


def free() -> Hold:
    """Return the latch of a real arm that somebody has let move."""
    hold = Hold(by_itself=False, t_ns=1)
    hold.resume(Resume(stop_t_ns=hold.stop.stop_t_ns))
    return hold


def test_a_real_arm_begins_held_and_an_emulated_one_free() -> None:
    with pytest.raises(StoppedError, match="`treenail resume` lets it move"):
        Hold(by_itself=False, t_ns=1).check(0.0)
    Hold(by_itself=True, t_ns=1).check(0.0)
    free().check(0.0)


def test_any_trouble_holds_a_real_arm_until_that_very_stop_is_named() -> None:
    hold = free()
    hold.trouble("robot: ARM POWER OFF", 100)
    first = hold.stop.stop_t_ns
    hold.trouble("robot: *E-STOP*", 90)  # the clock was set back meanwhile
    with pytest.raises(StoppedError, match="E-STOP"):
        hold.resume(Resume(stop_t_ns=first))
    with pytest.raises(StoppedError):
        hold.check(1e9)
    assert hold.resume(Resume(stop_t_ns=hold.stop.stop_t_ns)).stop_t_ns == 0
    hold.check(0.0)


def test_a_late_request_of_a_process_before_frees_nothing() -> None:
    before, now = Hold(by_itself=False, t_ns=1000), Hold(by_itself=False, t_ns=2000)
    with pytest.raises(StoppedError):
        now.resume(Resume(stop_t_ns=before.stop.stop_t_ns))
    assert now.held


def test_an_emulated_arm_tries_a_bounded_number_of_times_with_growing_pauses() -> None:
    hold, now_s = Hold(by_itself=True, t_ns=1), 0.0
    for number in range(MOST_FAILED - 1):
        hold.failed("robot: refused", number, now_s)
        with pytest.raises(PauseError):
            hold.check(now_s)
        now_s += 10.0
        hold.check(now_s)
    hold.failed("robot: refused", 99, now_s)
    with pytest.raises(StoppedError, match=f"{MOST_FAILED} motions failed one after the other: robot: refused"):
        hold.check(now_s + 1e9)


def test_a_motion_that_is_made_ends_the_count() -> None:
    hold = Hold(by_itself=True, t_ns=1)
    for number in range(10 * MOST_FAILED):
        hold.failed("robot: refused", number, 0.0)
        hold.succeeded()
    hold.check(1e9)


def test_a_dead_sensor_holds_an_emulated_arm_too() -> None:
    hold = Hold(by_itself=True, t_ns=1)
    hold.insist("guard: sensor", 5)
    with pytest.raises(StoppedError):
        hold.check(1e9)


@given(st.lists(st.sampled_from(["trouble", "failed", "made", "old resume"]), min_size=1, max_size=30))
def test_nothing_but_the_right_name_frees_a_real_arm(events: list[str]) -> None:
    hold = free()
    hold.trouble("robot: stop", 10)
    name = hold.stop.stop_t_ns
    for t_ns, event in enumerate(events):
        if event == "trouble":
            hold.trouble("robot: stop", t_ns)
        elif event == "failed":
            hold.failed("robot: refused", t_ns, 0.0)
        elif event == "made":
            hold.succeeded()
        elif hold.stop.stop_t_ns != name:
            with pytest.raises(StoppedError):
                hold.resume(Resume(stop_t_ns=name))
        assert hold.held
