"""What the agent answers when it is asked what it has learnt, and what it would do."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from services.wire.message_base import Count, Decision, Message, Motion, Number, RunId, Sha256, StateNumber


class QTable(Message, frozen=True, kw_only=True):
    """Reply to ``agent/q_table``: one row a state, one column an action; no rows where moves are proposed instead."""

    VERSION: ClassVar[int] = 2
    LARGEST_BYTES: ClassVar[int] = 1 << 22

    run: RunId
    decisions: Decision
    policy_version: Count
    actions: tuple[str, ...]
    q: tuple[tuple[Number, ...], ...]
    visits: tuple[tuple[Count, ...], ...]
    best_action: tuple[Count, ...]
    digest: Sha256
    partial: bool = False
    """True where a felt model's part is added to these values, so that they alone decide nothing."""


class PolicyAnswer(Message, frozen=True, kw_only=True):
    """Reply to ``agent/policy``: what the agent would do in one state, or when it feels one F/T vector."""

    VERSION: ClassVar[int] = 4

    run: RunId
    policy_version: Count
    state: StateNumber | None
    """None when an F/T vector fits no contact state known so far."""
    match: Annotated[float, Meta(ge=-1, le=1.000001)] | None
    """How well the F/T vector fits; None when a state was asked for."""
    known: bool
    """False for a state never decided in; its values are the initial zeros."""
    actions: tuple[str, ...]
    values: tuple[Number, ...]
    probabilities: tuple[Number, ...]
    visits: tuple[Count, ...]
    best_action: Count
    partial: bool = False
    """True where a felt model's part is missing from the values, because a state was asked for and no F/T vector."""
    model: tuple[Number, ...] = ()
    """Of a felt model, what each move is thought to earn at once: a part of its value; empty without one."""
    table: tuple[Number, ...] = ()
    """Of the same, what is thought to come after it: the other part."""
    deviations: tuple[Number, ...] = ()
    """Standard deviation of the model's part."""
    increment: Motion | None = None
    """Of a learner that proposes moves, the one that it would make without trying; it has no values of actions."""
    spread: Motion | None = None
    """Standard deviations that it tries moves with, axis by axis."""
    worth: Number | None = None
    """What it thinks that the move earns, in its own measure."""
