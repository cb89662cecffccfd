"""The swaps of a run as a worker's fold sees them: which it knows, and which of them it has made."""

from __future__ import annotations

from collections.abc import Sequence

from services.rules.swaps import in_force, known_in
from services.wire.definition import Definition
from services.wire.errors import DivergedError, GapError
from services.wire.messages import LoopMessage, Swap


class Timeline:
    """A run's definition, and what is swapped in the course of it."""

    def __init__(self, definition: Definition, swaps: Sequence[Swap] = ()) -> None:
        self._definition = definition
        self.known = tuple(swaps)
        """In the order in which they take effect."""
        self.made = 0
        """How many of them the memory includes."""

    @property
    def definition(self) -> Definition:
        """The definition with the swaps that were made."""
        return self.definition_after(self.made)

    def definition_after(self, swaps: int) -> Definition:
        """Return the definition with the first so many swaps. Raises ValueError when not so many are known."""
        if not 0 <= swaps <= len(self.known):
            raise ValueError(f"swaps: expected at most the {len(self.known)} that are known here, got {swaps}")
        return in_force(self._definition, self.known[:swaps])

    def learn_of(self, swaps: Sequence[Swap]) -> None:
        """Take note of the run's swaps, those known before among them. Raises DivergedError."""
        if tuple(swaps[: len(self.known)]) != self.known:
            raise DivergedError(f"swaps: expected the {len(self.known)} known here and perhaps more, got others")
        self.known = tuple(swaps)

    def due(self, message: LoopMessage) -> Sequence[Swap]:
        """Return the swaps to be made before a message is folded.

        Raises GapError when some that are in force are not known here, and DivergedError when there should be fewer.
        """
        count = known_in(self.known, message.episode)
        if count < message.swaps:
            raise GapError(f"swaps: expected to know {message.swaps} for episode {message.episode}, know {count}")
        if count > message.swaps or message.swaps < self.made:
            expected = max(count, self.made)
            raise DivergedError(
                f"swaps: expected {expected} in force in episode {message.episode}, got {message.swaps}"
            )
        return self.known[self.made : count]
