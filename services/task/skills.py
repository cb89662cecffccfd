"""Which skill the task's run begins with: the one that the store's ``checkpoint/skill/latest`` holds, if it fits.

It is asked for at the start and between episodes. Nothing is believed only when the store says that it has nothing.
"""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import zenoh

from services.bus.service import Service
from services.rules import skill
from services.rules.skill import NamedSkill, SkillError
from services.task.journal import wait_for_store
from services.wire.codec import decode
from services.wire.definition import Definition
from services.wire.errors import ContractError, NoAnswerError
from services.wire.keys import CHOSEN_SKILL, RUN, SKILL, name_of, wild
from services.wire.messages import RunRecord


class Chosen(NamedTuple):
    """What a run shall begin with; None for nothing learnt."""

    skill: NamedSkill | None


class _Look(NamedTuple):
    """What the store has as ``latest``."""

    sha256: str | None
    """Hash of the bytes there; None when nothing is."""
    skill: NamedSkill | None
    """None also when what is there cannot be begun with."""


_NOTHING = _Look(None, None)


class Skills:
    """Looks up the skill, and refuses those that do not fit the definition."""

    def __init__(self, service: Service, definition: Definition) -> None:
        self._service = service
        self._definition = definition
        self._last = _NOTHING
        self.noticed = False
        """Whether a change was announced since the store was asked; a reason to ask soon, no more."""
        service.subscribe_raw(CHOSEN_SKILL, self._on_change)

    def at_start(self, blank: RunRecord) -> Chosen | None:
        """Wait for the store and return what to begin with; None only when stopped.

        ``blank`` is the run that begins with nothing. Where the skill that shall be begun with does not fit, it is the
        same as before: that of the run of this definition and seed which was worked on last.
        """
        service = self._service
        while not service.stopping:
            try:
                look = self._look()
                if look.sha256 is None or look.skill is not None:
                    return Chosen(look.skill)
                chosen = self._as_before(blank)
                if chosen is not None:
                    return chosen
                wait_for_store(service, "no skill of the run that was worked on last")
            except NoAnswerError as error:
                wait_for_store(service, str(error))
        return None

    def between_episodes(self, present: NamedSkill | None) -> Chosen | None:
        """Return what to begin with from now on, or None for no change; never waits.

        ``present`` is what the present run began with.
        """
        self.noticed = False
        try:
            look = self._look()
        except NoAnswerError:
            return None
        if look.sha256 is not None and look.skill is None:
            return None
        unchanged = (None if present is None else present.sha256) == look.sha256
        return None if unchanged else Chosen(look.skill)

    def _look(self) -> _Look:
        """Return what the store has. Raises NoAnswerError."""
        samples = self._service.fetch_stored(CHOSEN_SKILL)
        if not samples:
            self._last = _NOTHING
            return _NOTHING
        payload = samples[0].payload.to_bytes()
        sha256 = hashlib.sha256(payload).hexdigest()
        if sha256 != self._last.sha256:
            self._last = _Look(sha256, self._usable(payload, str(samples[0].encoding)))
        return self._last

    def _usable(self, payload: bytes, encoding: str) -> NamedSkill | None:
        """Return the skill when a run can begin with it; else it is refused, and counted."""
        try:
            candidate = skill.decode(payload, encoding)
            skill.fits(candidate.skill, self._definition)
        except (ContractError, SkillError) as error:
            self._service.refuse(error)
            return None
        return candidate

    def _as_before(self, blank: RunRecord) -> Chosen | None:
        """Return what the run that was worked on last began with; None when the store does not have it any more.

        Raises NoAnswerError.
        """
        records: list[tuple[int, RunRecord]] = []
        for sample in self._service.fetch_stored(wild(RUN), 10.0):
            try:
                record = decode(RunRecord, sample.payload.to_bytes(), str(sample.encoding))
            except ContractError:
                continue  # of another version
            same = (record.definition_sha256, record.seed, record.contract_sha256)
            if same == (blank.definition_sha256, blank.seed, blank.contract_sha256) and sample.timestamp is not None:
                records.append((int(str(sample.timestamp.get_time_as_ntp64())), record))
        # The record is put whenever a run is taken up, so that the newest is that of the last one.
        newest = max(records, key=lambda item: item[0], default=None)
        sha256 = None if newest is None else newest[1].skill_sha256
        if sha256 is None:
            return Chosen(None)
        stored = self._service.fetch_stored(name_of(SKILL, sha256=sha256), 10.0)
        original = self._usable(stored[0].payload.to_bytes(), str(stored[0].encoding)) if stored else None
        return None if original is None else Chosen(original)

    def _on_change(self, sample: zenoh.Sample) -> None:
        self._service.handled += 1
        self.noticed = True
        if sample.kind == zenoh.SampleKind.PUT:
            skill.decode(sample.payload.to_bytes(), str(sample.encoding))  # the loop counts what is none
