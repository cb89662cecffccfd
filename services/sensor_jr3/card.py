"""What the driver needs of a receiver card, however it is reached, and what can be wrong with one.

TreenailError
+-- SettingError        a setting of the sensor that cannot be used
|   +-- UrlError        an address of a card that cannot be used, and why
+-- CardError           the card or its sensor cannot be used now; trying again may help
    +-- LinkError       the way to the card is broken
    +-- NoCardError     nothing at that address
    +-- NoSensorError   no sensor, or one that says that it does not work
    +-- CommandError    the card did not do what it was told, or not in time
    +-- ChangedError    somebody else changed the card or its sensor; it has to be set up anew
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from services.rules.settings import SettingError
from services.wire.errors import TreenailError


class UrlError(SettingError):
    """An address of a card that cannot be used."""


class CardError(TreenailError):
    """The card or its sensor cannot be used now."""


class LinkError(CardError):
    """The way to the card is broken."""


class NoCardError(CardError):
    """There is no card at that address."""


class NoSensorError(CardError):
    """There is no sensor at the card, or one that does not work."""


class CommandError(CardError):
    """The card did not do what it was told, or not in time."""


class ChangedError(CardError):
    """The card or its sensor is another than it was when it was set up."""


class Sample(NamedTuple):
    """One sample, read as one: the counter was the same before and after the rest."""

    counter: int
    """Modulo 65536."""
    counts: tuple[int, ...]
    """Fx Fy Fz Mx My Mz, signed."""
    warnings: int
    errors: int


class Collected(NamedTuple):
    """Samples taken since the last time, oldest first."""

    samples: list[Sample]
    newest_s: float
    """When the newest was taken, in seconds after the call began (negative: before); never later than it truly was."""


class Memory(Protocol):
    """The words of a card. All methods raise LinkError when the way to it is broken."""

    def read(self, address: int, count: int) -> list[int]:
        """Return ``count`` words from ``address`` on, unsigned, in one round trip."""
        ...

    def write(self, address: int, value: int) -> None:
        """Write one word, 0 to 65535."""
        ...


class Card(Memory, Protocol):
    """A card that is also sampled: by something that never misses a change of a counter, as a poll from here would."""

    def collect(self, counter: int, data: int, wait_s: float) -> Collected:
        """Return each sample since the last call once, waiting at most ``wait_s`` for the first.

        ``counter`` is the address of the counter that steps with the samples, ``data`` that of the words of a filter.
        The first call, and one with other addresses, begins anew.
        """
        ...

    def close(self) -> None:
        """Let go of the card."""
        ...


def signed(word: int) -> int:
    """Return a 16-bit word as the signed number in it."""
    return word - 0x10000 if word & 0x8000 else word


def hexadecimal(word: int) -> str:
    """Return a word as people write it."""
    return f"{word & 0xFFFF:04X}"
