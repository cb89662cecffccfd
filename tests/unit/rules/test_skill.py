"""A skill's name, file and fit; made by hand, as no learner is needed for these."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from services.rules import skill
from services.rules.skill import NamedSkill, SkillError
from services.wire import codec
from services.wire.actions import action_names
from services.wire.codec import contract_sha256, encode, encoding_of
from services.wire.definition import Art2Settings, Definition, Moves, Sarsa, Softmax, Start
from services.wire.definition_file import definition_sha256, run_id
from services.wire.errors import BadPayloadError, ContractError, WrongTypeError, WrongVersionError
from services.wire.messages import Skill

STATES = 3
DEFINITION = Definition(name="test")
OTHER_CONTRACT = "5a" * 32


def made(definition: Definition = DEFINITION, **fields: Any) -> NamedSkill:
    """Return a sound skill of three states, or one with other fields."""
    actions = action_names(definition.moves)
    visits = np.ones((STATES, len(actions)), "<i8")
    assert isinstance(definition.classifier, Art2Settings)
    inputs = 6 if definition.classifier.encoding == "odd" else 12
    sound = Skill(
        run=run_id(definition, 7),
        seed=7,
        definition=definition,
        definition_sha256=definition_sha256(definition),
        contract_sha256=contract_sha256(),
        skill_sha256=None,
        actions=actions,
        episodes=12,
        agent={
            "actions": len(actions),
            "states": STATES,
            "version": int(visits.sum()),
            "q": np.linspace(-4.0, 3.0, visits.size).astype("<f8").tobytes(),
            "visits": visits.tobytes(),
        },
        classifier={
            "states": STATES,
            "inputs": inputs,
            "weights": np.eye(STATES, inputs, dtype="<f8").tobytes(),
            "counts": np.ones(STATES, "<i8").tobytes(),
        },
    )
    return skill.named(replace(sound, **fields))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with the sound skill."""
    skill.write(tmp_path / "a.skill", made())
    return tmp_path / "a.skill"


def test_file_gives_back_what_was_written(file: Path) -> None:
    assert skill.read(file) == made()
    assert file.read_bytes() == skill.file_bytes(made())
    assert made().version == STATES * 9
    assert made().states == STATES


def test_name_is_the_hash_of_the_bytes_on_the_bus_and_of_the_file_behind_its_header(file: Path) -> None:
    name = made().sha256
    assert name == hashlib.sha256(encode(made().skill)).hexdigest()
    assert name == hashlib.sha256(file.read_bytes().split(b"\n", 4)[4]).hexdigest()
    assert skill.decode(encode(made().skill), encoding_of(Skill)) == made()
    assert made(episodes=13).sha256 != name


def test_no_damaged_file_is_taken(file: Path) -> None:
    whole = file.read_bytes()
    for size in range(len(whole)):
        with pytest.raises(SkillError):
            skill.parse(whole[:size])
    with pytest.raises(SkillError):
        skill.parse(whole + b"\0")
    for place in range(len(whole)):
        with pytest.raises((SkillError, ContractError)):
            skill.parse(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])


def forged(payload: bytes, version: int = 1, contract: str | None = None) -> bytes:
    """Return a file whose header agrees with any payload."""
    sha256 = hashlib.sha256(payload).hexdigest()
    header = f"treenail skill {version}\ncontract {contract or contract_sha256()}\nsha256 {sha256}\n"
    return f"{header}bytes {len(payload)}\n".encode() + payload


FIELDS = msgspec.to_builtins(made().skill, builtin_types=(bytes,))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "begins with 'treenail skill', got b''"),
        (b"PK\x03\x04 some archive", "begins with 'treenail skill', got b'PK"),
        (b"treenail skill 1\n", "begins with 'treenail skill'"),
        (forged(encode(made().skill), version=2), "of version 1, got version 2"),
        (
            forged(b"from another world", contract=OTHER_CONTRACT),
            f"contract {contract_sha256()[:12]}, got 5a5a5a5a5a5a",
        ),
        (forged(encode(made(contract_sha256=OTHER_CONTRACT).skill)), "got 5a5a5a5a5a5a"),
        (forged(b"\xc1"), "expected a MessagePack map"),
        (forged(msgpack.packb({**FIELDS, "more": 1})), "more"),
        (forged(msgpack.packb({**FIELDS, "episodes": -1})), "episodes"),
        (forged(msgpack.packb(dict(reversed(FIELDS.items())))), "expected the bytes that encoding it gives"),
        (forged(encode(made(seed=8).skill)), "run: expected"),
        (forged(encode(made(definition_sha256="ab" * 32).skill)), "definition_sha256: expected"),
        (forged(encode(made(actions=("+X",)).skill)), r"actions: expected \+X,-X"),
    ],
)
def test_what_is_no_sound_skill_is_said_in_one_line_with_the_file(
    tmp_path: Path, content: bytes, expected: str
) -> None:
    path = tmp_path / "b.skill"
    path.write_bytes(content)
    with pytest.raises(SkillError, match=expected) as raised:
        skill.read(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("whose", "change", "expected"),
    [
        ("agent", {"actions": 5}, "expected 9 actions, got 5"),
        ("agent", {"states": 4}, "expected 288 bytes, got 216 bytes"),
        ("agent", {"q": 3}, "got int"),
        ("agent", {"q": np.full(27, np.nan).tobytes()}, "action values"),
        ("agent", {"q": np.full(27, 2e12).tobytes()}, "action values"),
        ("agent", {"version": 28}, "add up to version 28"),
        ("agent", {"visits": np.full(27, -1, "<i8").tobytes()}, "add up to version"),
        ("agent", {"visits": np.array([27] + [0] * 26, "<i8").tobytes()}, "visits in the last of 3 states"),
        ("agent", {"more": 1}, "expected actions, q, states, version, visits, got actions, more"),
        ("classifier", {"inputs": 12}, "expected 6 inputs, got 12"),
        ("classifier", {"weights": np.zeros(18).tobytes()}, "of a norm above 0"),
        ("classifier", {"weights": np.full(18, 1e200).tobytes()}, "of a norm above 0"),
        ("classifier", {"weights": np.full(18, np.inf).tobytes()}, "of a norm above 0"),
        ("classifier", {"counts": np.zeros(3, "<i8").tobytes()}, "at least one presentation"),
        (
            "classifier",
            {"states": 2, "weights": np.eye(2, 6).tobytes(), "counts": np.ones(2, "<i8").tobytes()},
            "at most 2",
        ),
    ],
)
def test_memory_that_no_worker_could_load_is_refused(whose: str, change: dict[str, int | bytes], expected: str) -> None:
    memory = {**getattr(made().skill, whose), **change}
    with pytest.raises(BadPayloadError, match=expected):
        skill.decode(encode(made(DEFINITION, **{whose: memory}).skill), encoding_of(Skill))


def test_skill_of_nothing_is_sound() -> None:
    agent = {"actions": 9, "states": 0, "version": 0, "q": b"", "visits": b""}
    classifier = {"states": 0, "inputs": 6, "weights": b"", "counts": b""}
    blank = made(agent=agent, classifier=classifier, episodes=0)
    assert skill.parse(skill.file_bytes(blank)) == blank


def test_other_types_are_not_taken_from_the_bus() -> None:
    with pytest.raises(WrongTypeError):
        skill.decode(encode(made().skill), "text/plain")
    with pytest.raises(WrongVersionError):
        skill.decode(encode(made().skill), encoding_of(Skill)[:-1] + "9")


ART2 = DEFINITION.classifier


@pytest.mark.parametrize(
    ("definition", "expected"),
    [
        (Definition(name="t", moves=Moves(actions=5)), r"actions \+X,-X,\+Y,-Y,\+Z, got .*,-RY$"),
        (Definition(name="t", moves=Moves(actions=11)), r"-RZ, got .*,-RY$"),
        (Definition(name="t", moves=Moves(lateral_mm=0.4)), r"action \+X to be 0.4 mm or degrees, got 0.2"),
        (Definition(name="t", moves=Moves(insertion_mm=0.1)), r"action \+Z to be 0.1"),
        (Definition(name="t", moves=Moves(rotation_deg=0.1)), r"action \+RX to be 0.1"),
        (Definition(name="t", classifier=Art2Settings(capacity=2)), "classifier.capacity = 2 states, got 3"),
        *(
            (Definition(name="t", classifier=replace(ART2, **{name: value})), f"classifier.{name} = {value}, got")
            for name, value in {
                "encoding": "split",
                "torque_gain_per_m": 9.0,
                "a": 9.0,
                "b": 9.0,
                "c": 0.2,
                "d": 0.8,
                "e": 0.01,
                "theta": 0.1,
            }.items()
        ),
    ],
)
def test_experiment_that_a_skill_does_not_fit_is_told_both_sides(definition: Definition, expected: str) -> None:
    with pytest.raises(SkillError, match=expected):
        skill.fits(made().skill, definition)


def test_skill_may_be_taken_to_other_parts_poses_and_learners() -> None:
    definition = Definition(
        name="other",
        start=Start(x_mm=-1.0),
        learner=Sarsa(gamma=0.5),
        policy=Softmax(beta=1.0),
        classifier=replace(ART2, rho=0.5, learning_rate=1.0, capacity=STATES, when_full="refuse"),
    )
    skill.fits(made().skill, definition)
    skill.fits(made(definition=definition).skill, DEFINITION)


def test_file_is_replaced_only_when_told_to(file: Path) -> None:
    other = made(episodes=99)
    with pytest.raises(SkillError, match="expected no such file yet; --force replaces it"):
        skill.write(file, other)
    assert skill.read(file) == made()
    skill.write(file, other, force=True)
    assert skill.read(file) == other
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_places_that_cannot_be_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    for path, expected in (
        ("folder", "got a folder"),
        ("file/x", "cannot be written"),
        ("none/x", "cannot be written"),
    ):
        with pytest.raises(SkillError, match=expected):
            skill.write(tmp_path / path, made())
    os.mkfifo(tmp_path / "pipe")
    for path, expected in (("none", "got none"), ("folder", "something else"), ("pipe", "something else")):
        with pytest.raises(SkillError, match=expected):
            skill.read(tmp_path / path)
    (tmp_path / "file").write_bytes(b"treenail skill 1\n" * 100)
    monkeypatch.setattr(codec, "MAX_PAYLOAD_BYTES", 100)
    with pytest.raises(SkillError, match="expected at most 356 bytes, got more"):
        skill.read(tmp_path / "file")


def test_failed_write_leaves_the_old_file_and_nothing_beside_it(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(SkillError, match="cannot be written: No space left on device"):
        skill.write(file, made(episodes=99), force=True)
    assert [path.name for path in file.parent.iterdir()] == [file.name]
    assert skill.read(file) == made()
