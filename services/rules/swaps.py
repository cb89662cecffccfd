"""Swaps: another classifier, or another learner or policy of the agent, from an episode of a run on. Pure.

A swap keeps what was learnt where it still means the same: a Q-table between Q-learning and SARSA, and whatever their
settings and the policy are. Another classifier makes other states, so that classifier and agent begin with nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from services.rules import plugins
from services.wire.definition import (
    TD_LEARNERS,
    ClassifierSettings,
    Definition,
    FeltModel,
    LearnerSettings,
    Plugin,
    Policy,
    TdSettings,
)
from services.wire.definition_file import with_overrides, without_later
from services.wire.definition_rules import contradiction
from services.wire.errors import SwapError
from services.wire.message_base import MOST_SWAPS
from services.wire.messages import Swap, SwapRequest

LARGEST_BYTES = 8192
"""Of one swap: all of a run fit into one message."""
BUILT_IN = {"classifier": ("art2", "none"), "learner": (*TD_LEARNERS, "felt")}
"""Kinds that need no plug-in, by table of the definition."""
FELT_MEANING = ("torque_per_m", "unit_n", "force_stays")
"""Settings of the felt learner without which its model would mean something else."""
SPEC = "EPISODE:SERVICE:KEY=VALUE,..."
SPEC_HELP = "swap from an episode on, as in 100:agent:learner=sarsa or 100:classifier:rho=0.95; may be repeated"
"""Of an option ``--swap``."""
_GROUPS = {"classifier": plugins.CLASSIFIERS, "learner": plugins.LEARNERS}
_TABLES = {"classifier": "classifier", "agent": "learner"}

WorkerName = Literal["classifier", "agent"]


class Wish(NamedTuple):
    """What somebody wants swapped: ``learner=sarsa``, ``alpha=0.05``, ``policy.beta=8``, ``classifier=fuzzy-art``..."""

    service: str
    settings: tuple[str, ...]


def in_force(definition: Definition, swaps: Iterable[Swap]) -> Definition:
    """Return the definition with all of these swaps made."""
    for swap in swaps:
        tables = {"classifier": swap.classifier, "learner": swap.learner, "policy": swap.policy}
        definition = replace(definition, **{name: table for name, table in tables.items() if table is not None})
    return definition


def known_in(swaps: Sequence[Swap], episode: int) -> int:
    """Return how many of a run's swaps, which are in their order, are in force in an episode."""
    return sum(swap.episode <= episode for swap in swaps)


def fresh_at(swaps: Iterable[Swap], episode: int, service: WorkerName) -> bool:
    """Return whether a worker begins an episode with nothing learnt."""
    return any(swap.episode == episode and service in swap.fresh for swap in swaps)


def fresh_after(before: Definition, after: Definition) -> tuple[WorkerName, ...]:
    """Return who begins with nothing learnt when one definition takes the place of another."""
    if before.classifier != after.classifier:
        return ("classifier", "agent")
    if before.learner != after.learner and not _same_memory(before.learner, after.learner):
        return ("agent",)
    return ()


def _same_memory(before: LearnerSettings, after: LearnerSettings) -> bool:
    """Return whether what one learner knows means the same to another."""
    if isinstance(before, TdSettings) and isinstance(after, TdSettings):
        return True
    if isinstance(before, FeltModel) and isinstance(after, FeltModel):
        return all(getattr(before, name) == getattr(after, name) for name in FELT_MEANING)
    return False


def swap_for(definition: Definition, swaps: Sequence[Swap], request: SwapRequest, episode: int) -> Swap:
    """Return the swap that a request asks for, from ``episode`` on, after those that a run has.

    Raises SwapError or PluginError when it changes nothing, or asks for what cannot be.
    """
    if request.classifier is not None and (request.learner is not None or request.policy is not None):
        raise SwapError("swap: expected a classifier, or a learner or policy, got both")
    asked = Swap(
        request=request.request,
        episode=episode,
        classifier=request.classifier,
        learner=request.learner,
        policy=request.policy,
    )
    before = in_force(definition, swaps)
    after = in_force(before, (asked,))
    if before == after:
        raise SwapError("swap: expected something that changes, got what is in force already")
    if len(swaps) >= MOST_SWAPS:
        raise SwapError(f"swap: expected at most {MOST_SWAPS} in a run, got one more")
    if swaps and episode < swaps[-1].episode:
        raise SwapError(f"swap: expected episode {swaps[-1].episode} or later, as a swap is set for it, got {episode}")
    if len(msgspec.json.encode(asked)) > LARGEST_BYTES:
        raise SwapError(f"swap: expected at most {LARGEST_BYTES} bytes of settings, got more")
    if conflict := contradiction(after):
        raise SwapError(f"swap: {conflict[0]}: {conflict[1]}")
    plugins.check(after)
    return replace(asked, fresh=fresh_after(before, after))


def request_for(
    run: str, now: Definition, wish: Wish, episode: int | None, request: str | None = None, after: int | None = None
) -> SwapRequest:
    """Return the request for a wish in a run where ``now`` is in force; by default it is named by its content.

    ``after``: so many swaps must the run have, or the request is refused.

    Raises SwapError, DefinitionError or PluginError for what is not there or does not fit.
    """
    wished = _with_wish(now, wish)
    tables = {name: getattr(wished, name) for name in ("classifier", "learner", "policy")}
    different = {name: table for name, table in tables.items() if table != getattr(now, name)}
    if not different:
        raise SwapError(f"swap: expected something that changes, got {', '.join(wish.settings) or 'nothing'}")
    content = msgspec.json.encode((episode, different), order="sorted")
    name = hashlib.sha256(content).hexdigest()[:32] if request is None else request
    return SwapRequest(run=run, request=name, after=after, episode=episode, **different)


def planned(run: str, definition: Definition, specs: Iterable[str], episodes: int) -> tuple[Swap, ...]:
    """Return the swaps of a run of so many episodes in words like ``100:agent:learner=sarsa,alpha=0.05``.

    Raises SwapError, DefinitionError or PluginError.
    """
    swaps: tuple[Swap, ...] = ()
    for episode, wish in sorted((spec(text) for text in specs), key=lambda item: item[0]):
        check_episode(episode, 1, episodes)
        now = in_force(definition, swaps)
        swaps += (swap_for(definition, swaps, request_for(run, now, wish, episode), episode),)
    return swaps


def digest(swaps: Sequence[Swap]) -> str:
    """Return the SHA-256 in hex of what is swapped and when, whatever name it was asked for by."""
    return hashlib.sha256("\n".join(words(swap) for swap in swaps).encode()).hexdigest()


def spec(text: str) -> tuple[int, Wish]:
    """Return the episode and the wish in words like ``100:classifier:rho=0.95``. Raises SwapError."""
    number, _, rest = text.partition(":")
    service, _, settings = rest.partition(":")
    words = tuple(word.strip() for word in settings.split(","))
    if not (number.isascii() and number.isdigit() and len(number) < 10 and service in _TABLES and all(words)):
        expected = "EPISODE:agent:KEY=VALUE,... or EPISODE:classifier:KEY=VALUE,..., as in 100:agent:learner=sarsa"
        raise SwapError(f"--swap: expected {expected}, got {text[:100]!r}")
    return int(number), Wish(service, words)


def check_episode(episode: int, first: int, episodes: int) -> None:
    """Raise SwapError for an episode that no swap can be made at: expected is one from ``first`` in the run."""
    if not first <= episode < episodes:
        expected = f"{first} to {episodes - 1}, got {episode}"
        if first >= episodes:
            expected = f"one that has not begun, got {episode}: of {episodes} episodes the last has begun"
        raise SwapError(f"swap: episode: expected {expected}", "out_of_order")


def kind_of(table: ClassifierSettings | LearnerSettings | Policy) -> str:
    """Return the kind of a table of the definition; the name of a plug-in's."""
    return table.name if isinstance(table, Plugin) else str(table.__struct_config__.tag)


def words(swap: Swap) -> str:
    """Return a swap in a line: from when on, what, and what becomes of what was learnt."""
    parts = []
    for name, table in (("classifier", swap.classifier), ("learner", swap.learner), ("policy", swap.policy)):
        if table is not None:
            fields = without_later({name: msgspec.to_builtins(table)})[name]
            settings = table.settings if isinstance(table, Plugin) else fields
            given = ", ".join(f"{key}={value}" for key, value in settings.items() if key != "kind")
            parts.append(f"{name} {kind_of(table)}" + (f" ({given})" if given else ""))
    kept = {
        (): "keeps all that was learnt",
        ("agent",): "the agent STARTS FRESH: its Q-table is empty",
    }.get(swap.fresh, "classifier and agent START FRESH: no contact states, an empty Q-table")
    return f"from episode {swap.episode}: {' and '.join(parts)}; {kept}"


def _with_wish(now: Definition, wish: Wish) -> Definition:
    """Return a definition as somebody wants it. Raises SwapError or DefinitionError."""
    table = _TABLES[wish.service]
    fields: dict[str, object] = msgspec.to_builtins(now)
    overrides = []
    # The kind first, whatever the order: settings belong to the kind that is wanted.
    for setting in sorted(wish.settings, key=lambda text: text.partition("=")[0].strip() not in (table, "policy")):
        key, _, value = (part.strip() for part in setting.partition("="))
        if key == table:
            fields[table] = _table(now, table, value)
        elif wish.service == "agent" and key == "policy":
            overrides.append(f"policy.kind={value}")
        elif wish.service == "agent" and key.startswith("policy."):
            overrides.append(setting)
        else:
            prefix = f"{table}.settings" if _kind(fields, table) == "plugin" else table
            overrides.append(f"{prefix}.{setting}")
    return with_overrides(fields, overrides, "swap")


def _table(now: Definition, table: str, kind: str) -> dict[str, object]:
    """Return the table of a kind: the present one if it is of it, else a new one."""
    present = getattr(now, table)
    fields: dict[str, object] = msgspec.to_builtins(present)
    if kind == kind_of(present):
        return fields
    if table == "learner" and kind in TD_LEARNERS and isinstance(present, TdSettings):
        return {**fields, "kind": kind}  # what both know carries over
    if kind in BUILT_IN[table]:
        return {"kind": kind}
    kinds = (*BUILT_IN[table], *sorted(plugins.installed(_GROUPS[table])))
    kind = kind if kind in kinds else kind.replace("_", "-")
    if kind not in kinds:
        raise SwapError(f"swap: {table}: expected one of {', '.join(kinds)}, got {kind[:64]!r}")
    return {"kind": "plugin", "name": kind, "settings": {}}


def _kind(fields: dict[str, object], table: str) -> object:
    found = fields[table]
    return found.get("kind") if isinstance(found, dict) else None
