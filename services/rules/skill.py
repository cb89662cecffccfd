"""A learnt skill: its name, whether it is sound, whether it fits an experiment, and the file that it travels in.

A file is four lines of text and then the encoded bytes of one Skill:

    treenail skill 1
    contract <64 hex digits>
    sha256 <64 hex digits of the bytes that follow; this is the skill's name>
    bytes <how many follow>
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from services.rules.skill_memory import check_agent, check_classifier, check_felt, number
from services.rules.swaps import FELT_MEANING, in_force, kind_of
from services.wire import codec
from services.wire.actions import action_names, increments
from services.wire.codec import contract_sha256
from services.wire.definition import Art2Settings, Definition, FeltModel, Plugin, Unclassified
from services.wire.definition_file import definition_sha256, run_id
from services.wire.definition_rules import contradiction
from services.wire.errors import BadPayloadError, ContractError, TreenailError
from services.wire.messages import Skill
from services.wire.text import one_line

_HEADER = re.compile(
    rb"treenail skill (?P<version>[0-9]{1,9})\n"
    rb"contract (?P<contract>[0-9a-f]{64})\nsha256 (?P<sha256>[0-9a-f]{64})\nbytes (?P<bytes>[0-9]{1,12})\n"
)
_VERSION = 1
_HEADER_BYTES = 256
_MEANING = ("encoding", "torque_gain_per_m", "a", "b", "c", "d", "e", "theta")
"""Settings of the classifier without which prototypes would mean something else."""


class SkillError(TreenailError):
    """A learnt skill that cannot be used: a file that is none, or one that does not fit the experiment."""


class NamedSkill(NamedTuple):
    """A skill and its name, the SHA-256 of its encoded bytes."""

    sha256: str
    skill: Skill

    @property
    def version(self) -> int:
        """Learning updates in it: the policy version that a run with it begins with."""
        return number(self.skill.agent, "version")

    @property
    def states(self) -> int:
        """Contact states that it knows."""
        return number(self.skill.classifier, "states")


def named(skill: Skill) -> NamedSkill:
    """Return a skill with its name."""
    return NamedSkill(hashlib.sha256(codec.encode(skill)).hexdigest(), skill)


def decode(payload: bytes, encoding: str) -> NamedSkill:
    """Return the skill in a payload. Raises ContractError when it is none, or not sound, or of another contract."""
    return _sound(payload, codec.decode(Skill, payload, encoding))


def fits(skill: Skill, definition: Definition) -> None:
    """Raise SkillError when a run of a definition cannot begin with a skill.

    It can when actions, their sizes and order, and whatever gives the classifier's prototypes their meaning are the
    same; parts, start pose, rewards, learner, policy, vigilance and seed may differ.
    """
    learnt = in_force(skill.definition, skill.swaps)
    ours, theirs = ",".join(action_names(definition.moves)), ",".join(skill.actions)
    if ours != theirs:
        raise SkillError(f"skill: expected the actions {ours}, got {theirs}")
    sizes, learnt_sizes = increments(definition.moves), increments(learnt.moves)
    for name, size, learnt_size in zip(skill.actions, sizes, learnt_sizes, strict=True):
        if size != learnt_size:
            expected, got = sum(size), sum(learnt_size)
            raise SkillError(f"skill: expected action {name} to be {expected:g} mm or degrees, got {got:g}")
    _fits_plugins(definition, learnt)
    _fits_model(definition, learnt)
    if isinstance(definition.classifier, Art2Settings):
        for name in _MEANING:
            expected_value, got_value = getattr(definition.classifier, name), getattr(learnt.classifier, name)
            if expected_value != got_value:
                raise SkillError(f"skill: expected classifier.{name} = {expected_value}, got {got_value}")
        _check_capacity(definition.classifier, number(skill.classifier, "states"))


def read(path: Path) -> NamedSkill:
    """Return the skill in a file. Raises SkillError when it cannot be read, is damaged, or is of another contract."""
    try:
        if not path.exists():
            raise SkillError(f"{path}: expected a file with a skill, got none")
        if not path.is_file():
            raise SkillError(f"{path}: expected a file with a skill, got something else")
        largest = codec.MAX_PAYLOAD_BYTES + _HEADER_BYTES
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise SkillError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > largest:
        raise SkillError(f"{path}: expected at most {largest} bytes, got more")
    try:
        return parse(content)
    except (SkillError, ContractError) as error:
        raise SkillError(f"{path}: {error}") from error


def write(path: Path, skill: NamedSkill, *, force: bool = False) -> None:
    """Write a skill into a file: all of it or nothing.

    Raises SkillError when it cannot be written, or when there is such a file and ``force`` is not set.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        if path.is_dir():
            raise SkillError(f"{path}: expected the name of a file, got a folder")
        try:
            with beside.open("xb") as file:
                file.write(file_bytes(skill))
                file.flush()
                os.fsync(file.fileno())
            if force:
                beside.replace(path)
            else:
                os.link(beside, path)  # unlike a rename, it fails when the name is taken
        finally:
            beside.unlink(missing_ok=True)
    except FileExistsError:
        raise SkillError(f"{path}: expected no such file yet; --force replaces it") from None
    except OSError as error:
        raise SkillError(f"{path}: cannot be written: {error.strerror}") from error


def file_bytes(skill: NamedSkill) -> bytes:
    """Return the content of a skill's file."""
    payload = codec.encode(skill.skill)
    lines = (
        f"treenail skill {_VERSION}",
        f"contract {skill.skill.contract_sha256}",
        f"sha256 {skill.sha256}",
        f"bytes {len(payload)}",
    )
    return "".join(f"{line}\n" for line in lines).encode() + payload


def parse(content: bytes) -> NamedSkill:
    """Return the skill in the content of a file. Raises SkillError or ContractError."""
    contract, payload = _unpacked(content)
    _check_contract(contract)
    return _sound(payload, codec.decode_payload(Skill, payload))


def parse_own(content: bytes) -> NamedSkill:
    """Return the skill in the content of a file that comes with this very code, under today's contract.

    Whoever changes a message does not change what was learnt: what the definition does not say has its default, so
    that only the names have to be written anew. Raises SkillError or ContractError, also where a type no longer fits.
    """
    _, payload = _unpacked(content)
    skill = codec.decode_payload(Skill, payload)
    today = replace(
        skill,
        contract_sha256=contract_sha256(),
        definition_sha256=definition_sha256(skill.definition),
        run=run_id(skill.definition, skill.seed, skill.skill_sha256),
    )
    return _sound(codec.encode(today), today)


def _unpacked(content: bytes) -> tuple[str, bytes]:
    """Return the contract that a file names, and its payload, undamaged. Raises SkillError."""
    header = _HEADER.match(content)
    if header is None:
        raise SkillError(f"expected a skill's file, which begins with 'treenail skill', got {content[:16]!r}")
    if int(header["version"]) != _VERSION:
        raise SkillError(f"expected a skill's file of version {_VERSION}, got version {int(header['version'])}")
    payload, size = content[header.end() :], int(header["bytes"])
    if len(payload) != size:
        raise SkillError(f"expected {size} bytes after the header, got {len(payload)}")
    if hashlib.sha256(payload).hexdigest().encode() != header["sha256"]:
        raise SkillError(f"damaged: expected sha256 {header['sha256'][:12].decode()}, got another")
    return header["contract"].decode(), payload


def _sound(payload: bytes, skill: Skill) -> NamedSkill:
    """Return a skill with its name when a worker could load it. Raises BadPayloadError otherwise."""
    _check_contract(skill.contract_sha256)
    if codec.encode(skill) != payload:
        raise BadPayloadError("skill: expected the bytes that encoding it gives, got others")
    definition = skill.definition
    agree = (
        ("definition_sha256", definition_sha256(definition), skill.definition_sha256),
        ("run", run_id(definition, skill.seed, skill.skill_sha256), skill.run),
        ("actions", ",".join(action_names(definition.moves)), ",".join(skill.actions)),
    )
    for name, expected, got in agree:
        if expected != got:
            raise BadPayloadError(f"skill: {name}: expected {expected} as its definition has, got {one_line(got, 80)}")
    learnt = in_force(definition, skill.swaps)
    if conflict := contradiction(learnt):
        raise BadPayloadError(f"skill: swaps: {conflict[0]}: {conflict[1]}")
    # What a plug-in's memory has to look like, only the plug-in knows.
    if isinstance(learnt.learner, Plugin):
        states = number(skill.agent, "states")
    elif isinstance(learnt.learner, FeltModel):
        states = check_felt(skill.agent, definition.moves)
    else:
        states = check_agent(skill.agent, len(skill.actions))
    if isinstance(learnt.classifier, Plugin | Unclassified):
        classes = number(skill.classifier, "states")
    else:
        classes = check_classifier(skill.classifier, learnt.classifier)
        try:
            _check_capacity(learnt.classifier, classes)
        except SkillError as error:
            raise BadPayloadError(str(error)) from error
    if states > classes:
        raise BadPayloadError(f"skill: expected an agent with at most {classes} states, got {states}")
    return NamedSkill(hashlib.sha256(payload).hexdigest(), skill)


def _fits_plugins(definition: Definition, learnt: Definition) -> None:
    """Raise SkillError where a plug-in's memory would have to be read by something else, or told something else.

    So it is with one that has no classes; and moves that are proposed mean something only within the same bounds.
    """
    alone = Plugin | Unclassified
    for what in ("classifier", "learner"):
        expected, got = getattr(definition, what), getattr(learnt, what)
        if (isinstance(expected, alone) or isinstance(got, alone)) and expected != got:
            raise SkillError(f"skill: expected {what} {expected}, got {got}")
    bounds, learnt_bounds = definition.moves.continuous, learnt.moves.continuous
    if isinstance(definition.learner, Plugin) and bounds != learnt_bounds:
        raise SkillError(f"skill: expected moves.continuous {bounds}, got {learnt_bounds}")


def _fits_model(definition: Definition, learnt: Definition) -> None:
    """Raise SkillError where a felt model would be read by a table, or the other way round, or feel something else."""
    ours, theirs = definition.learner, learnt.learner
    expected, got = isinstance(ours, FeltModel), isinstance(theirs, FeltModel)
    if expected != got:
        raise SkillError(f"skill: expected learner.kind = {kind_of(ours)!r}, got {kind_of(theirs)!r}")
    if definition.felt != learnt.felt:
        raise SkillError(f"skill: expected torques referred as {definition.felt}, got {learnt.felt}")
    for name in FELT_MEANING if isinstance(ours, FeltModel) else ():
        expected_value, got_value = getattr(ours, name), getattr(theirs, name)
        if expected_value != got_value:
            way = f"; --set learner.{name}={str(got_value).lower()} takes it as it is"
            raise SkillError(f"skill: expected learner.{name} = {expected_value}, got {got_value}{way}")


def _check_contract(theirs: str) -> None:
    ours = contract_sha256()
    if theirs != ours:
        raise BadPayloadError(
            f"skill: expected contract {ours[:12]}, got {theirs[:12]}; use the version of Treenail that exported it"
        )


def _check_capacity(settings: Art2Settings, states: int) -> None:
    if states > settings.capacity:
        raise SkillError(f"skill: expected at most classifier.capacity = {settings.capacity} states, got {states}")
