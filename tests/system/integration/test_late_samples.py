"""F/T samples that come late or twice are taken for what they are: samples of another motion."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import zenoh

from services.wire.codec import decode
from services.wire.keys import FT
from services.wire.messages import FtPacket

EPISODES = 12
LATE = 10


def motions(sample: zenoh.Sample) -> int:
    """Return how many motions of its episode lie before a sample of the simulator."""
    return decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding)).sequence % 2**17


def test_samples_of_later_motions_do_not_mislead_a_task_that_makes_its_episode_again(
    live: Any, wait_until: Callable[..., None], reference: Callable[..., dict[str, str]]
) -> None:
    key = live.keys.of(FT)
    newest: deque[zenoh.Sample] = deque(maxlen=LATE)
    live.session.declare_subscriber(key, newest.append, allowed_origin=zenoh.Locality.REMOTE)
    enough = threading.Event()

    def say_again(late: list[zenoh.Sample]) -> None:
        """Put samples again and again, with the timestamp that says who sent them."""
        while not enough.is_set():
            for sample in late:
                live.session.put(key, sample.payload, encoding=sample.encoding, timestamp=sample.timestamp)
                enough.wait(0.001)

    live.start_loop(EPISODES)
    for _ in range(2):
        wait_until("an episode is under way", lambda: newest and motions(newest[-1]) > LATE + 5)
        live.processes["task"].popen.kill()
        live.processes["task"].end()
        enough.clear()
        again = threading.Thread(target=say_again, args=(list(newest),))
        again.start()
        try:
            live.start_loop(EPISODES, "task")
            live.wait_alive("task")
            live.wait_actions(5)
        finally:
            enough.set()
            again.join()
    assert live.digests() == reference(EPISODES)
