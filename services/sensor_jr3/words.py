"""The word protocol: a card's memory over a byte stream, one round trip a question. Pure.

All is 16-bit words, low byte first. A question is four words, an answer two and what follows them:

    question  operation, a, b, c
    answer    0 or why not (1), number of words that follow, those words (of an error: its text, a character a word)

    HELLO    0, 0, 0                 -> "J", "R", "3", version
    READ     address, count, 0       -> count words (1 to 1024)
    WRITE    address, value, 0       -> nothing
    COLLECT  counter, data, wait_ms  -> when (2 words), then 9 words a sample, oldest first, 1024 samples at most

COLLECT gives every sample since the last one: the counter at the first address, six words from the second on, warnings
and errors. It waits for the first at most ``wait_ms`` (0 to 1000). ``when`` is a signed 32-bit number of microseconds,
low word first: when the newest sample was taken, counted from the arrival of the question. One connection at a time
collects; another may take over when the first has not asked for a second. There is no encryption: keep it on one
machine or on a network of its own.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from services.sensor_jr3.card import Collected, LinkError, Sample, signed

HELLO, READ, WRITE, COLLECT = 1, 2, 3, 4
GREETING = (ord("J"), ord("R"), ord("3"), 1)
QUESTION_BYTES, ANSWER_BYTES = 8, 4
MOST_WORDS = 1024
MOST_SAMPLES = 1024
MOST_WAIT_MS = 1000
SAMPLE_WORDS = 9


class Question(NamedTuple):
    """What is asked of a card."""

    operation: int
    a: int = 0
    b: int = 0
    c: int = 0

    def pack(self) -> bytes:
        """Return its bytes."""
        return struct.pack("<4H", *self)


def question(data: bytes) -> Question:
    """Return the question in 8 bytes."""
    return Question(*struct.unpack("<4H", data))


def answer(words: list[int], refused: bool = False) -> bytes:
    """Return the bytes of an answer; ``words`` are 0 to 65535."""
    return struct.pack(f"<{2 + len(words)}H", int(refused), len(words), *words)


def refusal(text: str) -> bytes:
    """Return the bytes of an answer that says why not."""
    return answer([min(ord(character), 0xFFFF) for character in text[:MOST_WORDS]], refused=True)


def answer_head(data: bytes) -> tuple[bool, int]:
    """Return whether it is a refusal, and how many words follow. Raises LinkError for what is no answer."""
    refused, count = struct.unpack("<2H", data)
    if refused not in (0, 1) or count > 2 + MOST_SAMPLES * SAMPLE_WORDS:
        raise LinkError(f"card server: expected an answer, got {data.hex(' ')}: is something else listening there?")
    return bool(refused), count


def unpack(data: bytes) -> list[int]:
    """Return the words in an answer's bytes."""
    return list(struct.unpack(f"<{len(data) // 2}H", data))


def text_of(words: list[int]) -> str:
    """Return the text of a refusal."""
    return "".join(chr(word) for word in words if word not in range(0xD800, 0xE000))


def collected_words(collected: Collected) -> list[int]:
    """Return what answers COLLECT."""
    microseconds = max(-(2**31), min(2**31 - 1, round(collected.newest_s * 1e6))) & 0xFFFFFFFF
    words = [microseconds & 0xFFFF, microseconds >> 16]
    for sample in collected.samples:
        words += [sample.counter, *(count & 0xFFFF for count in sample.counts), sample.warnings, sample.errors]
    return words


def collected_in(words: list[int]) -> Collected:
    """Return what COLLECT was answered. Raises LinkError for words that are no samples."""
    if len(words) < 2 or (len(words) - 2) % SAMPLE_WORDS:
        raise LinkError(f"card server: expected 2 words and {SAMPLE_WORDS} a sample, got {len(words)}")
    microseconds = words[0] | words[1] << 16
    microseconds -= (microseconds & 0x80000000) << 1
    return Collected(samples_in(words[2:]), microseconds * 1e-6)


def samples_in(words: list[int]) -> list[Sample]:
    """Return the samples in whole records of words."""
    samples = []
    for start in range(0, len(words), SAMPLE_WORDS):
        counter, *counts, warnings, errors = words[start : start + SAMPLE_WORDS]
        samples.append(Sample(counter, tuple(signed(count) for count in counts), warnings, errors))
    return samples
