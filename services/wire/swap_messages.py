"""The messages about swaps; see docs/swap.md."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta, Struct

from services.wire.definition import ClassifierSettings, LearnerSettings, Policy
from services.wire.message_base import LONGEST_RUN, MOST_SWAPS, Message, RequestId, RunId


class Swap(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One swap of a run: what learns from an episode on. Tables that are None stay as they are."""

    request: RequestId
    """Name of the request for it: asked for again, it is not done again."""
    episode: Annotated[int, Meta(ge=1, le=LONGEST_RUN - 1)]
    """The first episode that it is in force in."""
    classifier: ClassifierSettings | None = None
    learner: LearnerSettings | None = None
    policy: Policy | None = None
    fresh: tuple[Literal["classifier", "agent"], ...] = ()
    """Who begins that episode with nothing learnt; who is not here keeps all that it has learnt."""


class SwapRequest(Message, frozen=True, kw_only=True):
    """Request on ``swap``: another classifier, or another learner or policy of the agent, while the run goes on."""

    VERSION: ClassVar[int] = 2
    LARGEST_BYTES: ClassVar[int] = 1 << 13

    run: RunId
    request: RequestId
    """Any; whoever got no reply asks again with the same."""
    after: Annotated[int, Meta(ge=0, le=MOST_SWAPS)] | None = None
    """How many swaps the run had when this was worked out; refused when it has others by now. None: no matter."""
    episode: Annotated[int, Meta(ge=1, le=LONGEST_RUN - 1)] | None = None
    """From which episode on; None for the first that has not begun."""
    classifier: ClassifierSettings | None = None
    learner: LearnerSettings | None = None
    policy: Policy | None = None


class Swapped(Message, frozen=True, kw_only=True):
    """Reply to ``swap``: the swap as the store has it, the ``number``-th of its run, from 1."""

    run: RunId
    number: Annotated[int, Meta(ge=1, le=MOST_SWAPS)]
    swap: Swap


class Swaps(Message, frozen=True, kw_only=True):
    """``journal/<run>/all-swaps``: all swaps of a run, in the order in which they take effect."""

    LARGEST_BYTES: ClassVar[int] = 1 << 20

    run: RunId
    swaps: Annotated[tuple[Swap, ...], Meta(min_length=1, max_length=MOST_SWAPS)]
