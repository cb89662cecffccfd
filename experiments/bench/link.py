"""``bench link``: the robot link's machines by themselves, without a port: DDCMP, and the terminal's dialogue."""

from __future__ import annotations

import time

from experiments.bench.link_dialogue import MODES, Dialogue, Mode
from experiments.bench.noisy_line import BYTE_S, CLEAN, Damage, exchange
from experiments.bench.values import Value, spread
from services.wire.actions import Increment
from services.wire.errors import TreenailError

BIT_ERRORS = 1e-4
MESSAGE_BYTES = 40
"""About a DO MOVE line and its prefix."""
LATERAL_MM = 0.2
_LINES = {"clean": CLEAN, "bit_errors_1e-4": Damage(bit_errors=BIT_ERRORS)}


def link(messages: int, moves: int, rounds: int) -> dict[str, Value]:
    """Measure messages exchanged both ways over a line in memory, and moves by dialogue with the emulated controller.

    ``at_9600_baud`` is calculated from the line's own time, the others are what this machine takes. Raises
    TreenailError when something arrives that was not sent, or does not arrive.
    """
    return {
        "rounds": rounds,
        "messages": messages,
        "message_bytes": MESSAGE_BYTES,
        "moves": moves,
        "ddcmp": {name: _ddcmp(damage, messages, rounds) for name, damage in _LINES.items()},
        "dialogue": {mode: {"moves_per_s": spread([_moves(mode, moves) for _ in range(rounds)])} for mode in MODES},
    }


def _ddcmp(damage: Damage, messages: int, rounds: int) -> dict[str, Value]:
    left, right = (
        [side + n.to_bytes(4, "big") * ((MESSAGE_BYTES - len(side)) // 4) for n in range(messages)]
        for side in (b"left", b"back")
    )
    taken_s, line_s, again = [], [], []
    for number in range(rounds):
        began = time.perf_counter()
        done = exchange(left, right, damage, seed=number)
        taken_s.append(time.perf_counter() - began)
        if (done.left, done.right) != (right, left):
            raise TreenailError("bench link: expected every message once and in order, got others")
        line_s.append(done.seconds)
        again.append(sum(end.counts.sent_again for end in done.ends) / (2 * messages))
    return {
        "messages_per_s": spread([2 * messages / seconds for seconds in taken_s]),
        "payload_bytes_per_s": spread([2 * messages * MESSAGE_BYTES / seconds for seconds in taken_s]),
        "at_9600_baud_messages_per_s": spread([2 * messages / seconds for seconds in line_s]),
        "at_9600_baud_payload_share": sum(messages * MESSAGE_BYTES * BYTE_S / seconds for seconds in line_s) / rounds,
        "sent_again_share": sum(again) / rounds,
    }


def _moves(mode: Mode, moves: int) -> float:
    """Return moves per second, to and fro along X."""
    dialogue = Dialogue(mode)
    motions = dialogue.controller.motions
    steps = [Increment(dx_mm=LATERAL_MM if n % 2 else -LATERAL_MM) for n in range(1, moves + 1)]
    began = time.perf_counter()
    applied = [dialogue.move(increment, n) for n, increment in enumerate(steps, 1)]
    seconds = time.perf_counter() - began
    if applied != steps or dialogue.controller.motions != motions + moves:
        raise TreenailError(f"bench link: expected {moves} moves as asked for, got others")
    return moves / seconds
