"""The flag that signals set: however many come, and whenever."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from services.bus.stop_flag import StopFlag

CHILD = """
import threading
from services.bus.stop_flag import StopFlag
stop = StopFlag()
threading.Thread(target=threading.Event().wait, daemon=True).start()
print("ready", flush=True)
while not stop.wait(0.001):
    pass
for _ in range(2000):  # signals go on coming
    stop.wait()
print("stopped", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_any_number_of_signals_stop_a_process(number: signal.Signals) -> None:
    for _ in range(5):
        with subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                for _ in range(300):
                    process.send_signal(number)
                assert process.stdout.readline() == "stopped\n"
                assert process.wait(30.0) in (0, -number)  # one may come while the interpreter ends
            finally:
                process.kill()


def test_waiting_ends_with_the_time_or_the_signal() -> None:
    stop = StopFlag(signal.SIGUSR1)
    try:
        assert not stop.wait(0.01)
        assert not stop
        sender = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR1))
        sender.start()
        assert stop.wait()
        assert stop and stop.is_set() and stop.wait(0.0)
        sender.join()
    finally:
        stop.restore()
    assert signal.getsignal(signal.SIGUSR1) == signal.SIG_DFL
