"""Definitions: read, overridden, checked, hashed; what does not fit is named with file and line."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from services.classifier.art2 import Art2
from services.wire import definition_file
from services.wire.definition import (
    Art2Settings,
    Definition,
    EpsilonAnnealed,
    EpsilonGreedy,
    FeltModel,
    ForceChangeReward,
    Greedy,
    InsertionReward,
    LearnerSettings,
    Limits,
    Moves,
    Noise,
    QLearning,
    Softmax,
    Start,
)
from services.wire.definition_file import _LATER, definition_sha256, find, load, run_id, seed_of, shipped
from services.wire.errors import DefinitionError

Write = Callable[[str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def put(text: str) -> str:
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return put


def refusal(name: str, *overrides: str) -> str:
    with pytest.raises(DefinitionError) as error:
        load(name, overrides)
    assert "\n" not in str(error.value)
    return str(error.value)


# -- files ---------------------------------------------------------------------------------------------------------


def test_there_are_shipped_definitions() -> None:
    assert "chamfered-q-softmax" in shipped()


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_definition_loads_under_its_own_name(name: str) -> None:
    definition = load(name)
    assert definition.name == name
    assert definition.source
    assert definition.title
    assert isinstance(definition.classifier, Art2Settings)
    Art2(definition.classifier)


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_definition_has_noise_and_one_key_switches_it_off(name: str) -> None:
    force_n, torque_nm = (1.0, 0.07) if name in ("suite-noisy", "suite-heavy-tool") else (0.04, 0.0027)
    assert load(name).noise == Noise(force_n=force_n, torque_nm=torque_nm, along_mm=0.025, across_mm=0.021)
    assert load(name, ["noise.scale=0"]).noise.scale == 0.0


def test_shipped_definitions_are_all_different() -> None:
    hashes = {definition_sha256(load(name)) for name in shipped()}
    assert len(hashes) == len(shipped())


def test_a_file_of_ones_own_is_found_by_its_path(write: Write) -> None:
    path = write('name = "mine"\n[start]\nx_mm = 2\n')
    assert find(path) == Path(path)
    assert load(path) == Definition(name="mine", start=Start(x_mm=2.0))


def test_what_is_not_given_has_its_default(write: Write) -> None:
    assert load(write('name = "mine"')) == Definition(name="mine")


def test_an_unknown_name_is_refused_with_a_hint() -> None:
    message = refusal("chamfered-q-softmx")
    assert "got 'chamfered-q-softmx'" in message
    assert "did you mean 'chamfered-q-softmax'?" in message
    assert "did you mean" not in refusal("zzz")
    assert "`treenail experiment list`" in refusal("zzz") and len(refusal("zzz")) < 160, "the names themselves are many"


def test_a_folder_is_no_definition(tmp_path: Path) -> None:
    assert "which is neither" in refusal(str(tmp_path))


def test_broken_toml_is_named_with_file_and_line(write: Write) -> None:
    path = write('name = "mine"\n[start\n')
    message = refusal(path)
    assert message.startswith(f"{path}: not valid TOML: ")
    assert "line 2" in message


def test_a_key_given_twice_is_no_toml(write: Write) -> None:
    assert "not valid TOML" in refusal(write('name = "mine"\nname = "yours"\n'))


def test_text_that_is_no_utf8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b'name = "\xff"')
    assert refusal(str(path)).startswith(f"{path}: expected UTF-8 text: ")


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n', encoding="utf-8-sig")
    assert definition_file.load(str(path)).name == "mine"


def test_a_file_beyond_the_limit_is_refused(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write('name = "mine"\n')
    monkeypatch.setattr(definition_file, "_MAX_FILE_BYTES", 5)
    assert refusal(path) == f"{path}: expected at most 5 bytes, got 14"


# -- errors name file, line, key, expected, got --------------------------------------------------------------------

WRONG = [
    ('name = "mine"\n[start]\nx_mm = 99.0\n', 3, "start.x_mm: expected `float` <= 20.0, got 99.0"),
    ('name = "mine"\n\n# note\n[start] # note\n  x_mm=nan\n', 5, "start.x_mm: expected `float` >= -20.0, got nan"),
    ('name = "mine"\n[start]\nx_mm = inf\n', 3, "start.x_mm: expected `float` <= 20.0, got inf"),
    ('name = "mine"\n[start]\nx_mm = "2"\n', 3, "start.x_mm: expected `float`, got `str`"),
    ('name = "mine"\n[start]\nx_mm = true\n', 3, "start.x_mm: expected `float`, got `bool`"),
    ('name = "mine"\n[start]\nx_m = 1\n', 3, "start.x_m: unknown key; did you mean 'x_mm'?"),
    ('name = "mine"\n[start]\nqqqqq = 1\n', 3, "start.qqqqq: unknown key; expected one of decimals, height_mm, rx_deg"),
    ('name = "mine"\n[stat]\nx_mm = 1\n', 2, "stat: unknown key; did you mean 'start'?"),
    ('name = "mine"\nepisodes = 0\n', 2, "episodes: expected `int` >= 1, got 0"),
    ('name = "mine"\nepisodes = 1.0\n', 2, "episodes: expected `int`, got `float`"),
    ('name = "mine"\nstart.x_mm = 99\n', 2, "start.x_mm: expected `float` <= 20.0, got 99"),
    ('name = "mine"\nstart = { x_mm = 99 }\n', 2, "start.x_mm: expected `float` <= 20.0, got 99"),
    ('name = "mine"\nstart = 5\n', 2, "start: expected `object`, got `int`"),
    ('name = "Mine"\n', 1, "name: expected 1 to 64 of a-z 0-9 -, the first of a-z 0-9, got 'Mine'"),
    ('name = "mine"\n[learner]\nkind = "plugin"\nname = "A"\n', 4, "learner.name: expected 1 to 64 of a-z 0-9 _ -"),
    (
        'name = "mine"\n[parts]\nshape = "oval"\n',
        3,
        "parts.shape: expected one of 'round', 'square', 'rectangle', 'triangle', got 'oval'",
    ),
    ('name = "mine"\n[moves]\nactions = 7\n', 3, "moves.actions: expected one of 5, 9, 11, got 7"),
    (
        'name = "mine"\n[policy]\nkind = "lucky"\n',
        3,
        "policy.kind: expected one of 'greedy', 'epsilon_greedy', 'epsilon_annealed', 'softmax', 'thompson', "
        "got 'lucky'",
    ),
    (
        'name = "mine"\n[reward]\nkind = "gold"\n',
        3,
        "reward.kind: expected one of 'insertion', 'force_change', got 'gold'",
    ),
    (
        'name = "mine"\n[learner]\nkind = "dqn"\n',
        3,
        "learner.kind: expected one of 'q_learning', 'sarsa', 'felt', 'plugin', got 'dqn'",
    ),
    ('name = "mine"\n[policy]\nbeta = 1.0\n', 2, "policy: object missing required field `kind`"),
    (
        'name = "mine"\n[limits]\ncontact_force_n = 5.0\ncollision_force_n = 5.0\n',
        3,
        "limits.contact_force_n: expected less than limits.collision_force_n = 5.0, got 5.0",
    ),
    (
        'name = "mine"\n[limits]\nhard_force_n = 10.0\n',
        3,
        "limits.hard_force_n: expected more than limits.collision_force_n = 10.0, got 10.0",
    ),
    (
        'name = "mine"\n[parts]\npeg_width_mm = 2.0\nclearance_mm = 2.0\n',
        4,
        "parts.clearance_mm: expected less than parts.peg_width_mm = 2.0, got 2.0",
    ),
    (
        'name = "mine"\n[start]\nheight_mm = 0.3\nx_mm = 3.0\n',
        3,
        "start.height_mm: expected more than 0.399, or the tilted tip starts inside the material, got 0.3",
    ),
    (
        'name = "mine"\n[start]\nheight_mm = 0.45\nx_mm = 3.4\nrz_deg = 1.0\n[parts]\nshape = "square"\n',
        3,
        "start.height_mm: expected more than 0.476, or the tilted tip starts inside the material, got 0.45",
    ),
    (
        'name = "mine"\n[start]\ntilt_spread_deg = 5.0\n[parts]\nchamfer_mm = 0.0\n',
        2,
        "start.height_mm: expected more than 1.870, or the tilted tip starts inside the material, got 1.0",
    ),
    (
        'name = "mine"\n[parts]\nshape = "rectangle"\n',
        2,
        "parts.peg_breadth_mm: expected at least 2.0 with shape 'rectangle' and 0 with any other, got 0.0 and 'rec",
    ),
    (
        'name = "mine"\n[parts]\npeg_breadth_mm = 5.0\n',
        3,
        "parts.peg_breadth_mm: expected at least 2.0 with shape 'rectangle' and 0 with any other, got 5.0 and 'round'",
    ),
    (
        'name = "mine"\n[start]\nheight_mm = 0.3\nx_mm = 3.0\n[parts]\nshape = "triangle"\n',
        3,
        "start.height_mm: expected more than 0.439, or the tilted tip starts inside the material, got 0.3",
    ),
    (
        'name = "mine"\n[start]\nheight_mm = 1.0\n[hole]\nrx_deg = 8.0\n',
        3,
        "start.height_mm: expected more than 2.428, or the tilted tip starts inside the material, got 1.0",
    ),
    (
        'name = "mine"\n[[changes]]\nepisode = 5\nkey = "contact.friction"\nvalue = 3.0\n',
        2,
        "changes: in episode 5: contact.friction: expected `float` <= 2.0",
    ),
    (
        'name = "mine"\n[[changes]]\nepisode = 5\nkey = "parts.shape"\nvalue = 3.0\n',
        4,
        "changes[0].key: expected one of 'contact.friction', 'contact.stiffness_n_per_mm', 'parts.clearance_mm'",
    ),
    (
        'name = "mine"\n[[changes]]\nepisode = 5\nkey = "contact.stiffness_n_per_mm"\nvalue = 0.5\n',
        2,
        "changes: in episode 5: contact.stiffness_n_per_mm: expected 0 for a rigid peg or at least 1.0, got 0.5",
    ),
    (
        'name = "mine"\nchanges = [{episode = 5, key = "contact.friction", value = 0.1}, '
        '{episode = 4, key = "contact.friction", value = 0.1}]\n',
        2,
        "changes: expected the order of the episodes, got [5, 4]",
    ),
    (
        'name = "mine"\n[wrist]\nsensor_rx_deg = 3.0\nsensor_mount = "unknown"\n',
        4,
        "wrist.sensor_mount: expected 'given' with angles of the sensor, got 'unknown' and (3.0, 0.0, 0.0)",
    ),
    (
        'name = "mine"\n[start]\nrx_spread_deg = 5.0\n[parts]\nchamfer_mm = 0.0\n',
        2,
        "start.height_mm: expected more than 1.471, or the tilted tip starts inside the material, got 1.0",
    ),
    (
        'name = "mine"\n[contact]\nstiffness_n_per_mm = 0.2\n',
        3,
        "contact.stiffness_n_per_mm: expected 0 for a rigid peg or at least 1.0, got 0.2",
    ),
    ('name = "mine"\n[parts]\nclearance_mm = -0.1\n', 3, "parts.clearance_mm: expected `float` > 0.0, got -0.1"),
    ('name = "mine"\n[parts]\nclearance_mm = 0.0\n', 3, "parts.clearance_mm: expected `float` > 0.0, got 0.0"),
    ('name = "mine"\n[start]\nheight_mm = -1.0\n', 3, "start.height_mm: expected `float` > 0.0, got -1.0"),
    ('name = "mine"\n[moves]\nlateral_mm = 0\n', 3, "moves.lateral_mm: expected `float` > 0.0, got 0"),
    ('name = "mine"\n[moves]\ninsertion_mm = 0.0\n', 3, "moves.insertion_mm: expected `float` > 0.0, got 0.0"),
    ('name = "mine"\n[moves]\nrotation_deg = -0.1\n', 3, "moves.rotation_deg: expected `float` > 0.0, got -0.1"),
    ('name = "mine"\n[noise]\nalong_mm = -0.1\n', 3, "noise.along_mm: expected `float` >= 0.0, got -0.1"),
    (
        'name = "mine"\n[limits]\ncollision_force_n = 30.0\n',
        2,
        "limits.hard_force_n: expected more than limits.collision_force_n = 30.0, got 20.0",
    ),
    (
        'name = "mine"\n[sensor]\nfull_scale_n = 200\n',
        2,
        "sensor.full_scale_dnm: expected 0 if and only if sensor.full_scale_n = 200 is, got 0",
    ),
    (
        'name = "mine"\n[sensor]\nfull_scale_n = 12\nfull_scale_dnm = 60\n',
        3,
        "sensor.full_scale_n: expected 0 or at least limits.hard_force_n = 20.0, got 12",
    ),
]


@pytest.mark.parametrize(("text", "line", "complaint"), WRONG, ids=[complaint[:40] for _, _, complaint in WRONG])
def test_what_does_not_fit_is_named_with_file_and_line(write: Write, text: str, line: int, complaint: str) -> None:
    path = write(text)
    assert refusal(path).startswith(f"{path}:{line}: {complaint}")


def test_a_missing_name_is_named_with_the_file(write: Write) -> None:
    path = write("episodes = 5\n")
    assert refusal(path).startswith(f"{path}: object missing required field `name`")


def test_a_key_of_another_kind_is_not_recommended_to_itself(write: Write) -> None:
    message = refusal(write('name = "mine"\n[policy]\nkind = "softmax"\nepsilon = 0.1\n'))
    assert "policy.epsilon: not a key of this kind of policy" in message
    assert "did you mean 'epsilon'" not in message


@pytest.mark.parametrize(("encoding", "inputs"), [("odd", 6), ("split", 12)])
def test_a_theta_that_would_silence_the_classifier_is_refused(encoding: str, inputs: int) -> None:
    """ART2 refuses theta from 1/sqrt(inputs) on; the definition must, or the classifier dies of it when it starts."""
    silent = 1 / math.sqrt(inputs) + 0.001
    message = refusal("chamfered-q-softmax", f"classifier.theta={silent}", f"classifier.encoding={encoding}")
    assert "classifier.theta" in message
    load("chamfered-q-softmax", [f"classifier.theta={silent - 0.01}", f"classifier.encoding={encoding}"])


def test_a_tilted_tip_may_start_over_the_opening_though_its_edge_is_below_the_mouth(write: Write) -> None:
    assert load(write('name = "mine"\n[start]\nheight_mm = 0.3\nx_mm = 2.0\n')).start.height_mm == 0.3
    assert load(write('name = "mine"\nparts.shape = "square"\nstart.height_mm = 0.45\n')).start.height_mm == 0.45


# -- overrides -----------------------------------------------------------------------------------------------------


def test_overrides_take_toml_values_and_bare_words(write: Write) -> None:
    path = write('name = "mine"\n')
    changes = [
        "start.x_mm=2",
        "start.y_mm = -0.5",
        "episodes=7",
        "parts.shape=square",
        'title="a = b"',
        "moves.actions=11",
        "start.rx_deg=1e-3",
    ]
    definition = load(path, changes)
    assert definition == Definition(
        name="mine",
        title="a = b",
        episodes=7,
        start=Start(x_mm=2.0, y_mm=-0.5, rx_deg=1e-3),
        parts=definition.parts,
        moves=Moves(actions=11),
    )
    assert definition.parts.shape == "square"
    assert isinstance(definition.start.x_mm, float)


def test_the_last_override_of_a_key_counts(write: Write) -> None:
    assert load(write('name = "mine"\n'), ["episodes=7", "episodes=8"]).episodes == 8


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["policy.kind=greedy"], Greedy()),
        (["policy.kind=epsilon_greedy"], EpsilonGreedy()),
        (["policy.kind=epsilon_greedy", "policy.epsilon=0.2"], EpsilonGreedy(epsilon=0.2)),
        (["policy.kind=epsilon_annealed", "policy.mu=1"], EpsilonAnnealed(mu=1.0)),
        (["policy.kind=softmax"], Softmax(beta=3.0)),
        (["policy.beta=4.0"], Softmax(beta=4.0)),
        (["policy.kind=greedy", "policy.kind=softmax"], Softmax()),
        (['policy={kind="epsilon_greedy", epsilon=0.3}'], EpsilonGreedy(epsilon=0.3)),
    ],
)
def test_the_kind_of_a_policy_can_be_switched(write: Write, overrides: list[str], expected: object) -> None:
    path = write('name = "mine"\n[policy]\nkind = "softmax"\nbeta = 3.0\n')
    assert load(path, overrides).policy == expected


def test_the_kind_of_a_reward_can_be_switched(write: Write) -> None:
    path = write('name = "mine"\n[reward]\nkind = "insertion"\nstep = -2.0\n')
    assert load(path).reward == InsertionReward(step=-2.0)
    assert load(path, ["reward.kind=force_change", "reward.fell=7"]).reward == ForceChangeReward(fell=7.0)


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("start.x_mm", "--set start.x_mm: expected key=value"),
        ("=1", "--set =1: expected key=value"),
        ("a b=1", "--set a b=1: expected key=value"),
        (".=1", "--set .=1: expected key=value"),
        ("start..x_mm=1", "--set start..x_mm=1: expected key=value"),
        ("start.x_mm=99", "--set start.x_mm=99: start.x_mm: expected `float` <= 20.0, got 99"),
        ("start.x_mm=nan", "--set start.x_mm=nan: start.x_mm: expected `float` >= -20.0, got nan"),
        ("start.x_mm=two", "--set start.x_mm=two: start.x_mm: expected `float`, got `str`"),
        ("start.x_mm=", "--set start.x_mm=: start.x_mm: expected `float`, got `str`"),
        ("start.x=1", "--set start.x=1: start.x: unknown key"),
        ("strat.x_mm=1", "--set strat.x_mm=1: strat: unknown key; did you mean 'start'?"),
        ("start.x_mm.y=1", "--set start.x_mm.y=1: x_mm is a value, not a table"),
        ("start=1", "--set start=1: start: expected `object`, got `int`"),
        ("episodes=true", "--set episodes=true: episodes: expected `int`, got `bool`"),
        ("limits.hard_force_n=1", "--set limits.hard_force_n=1: limits.hard_force_n: expected more than"),
        ("policy.kind=lucky", "--set policy.kind=lucky: policy.kind: expected one of 'greedy'"),
    ],
)
def test_an_override_that_does_not_fit_is_named(override: str, complaint: str) -> None:
    assert refusal("chamfered-q-softmax", override).startswith(complaint)


def test_an_override_is_one_value_only() -> None:
    with pytest.raises(DefinitionError):
        load("chamfered-q-softmax", ["start.x_mm=2\ny_mm=1"])


# -- hashes --------------------------------------------------------------------------------------------------------


def test_the_hash_does_not_depend_on_the_order_of_keys_or_on_defaults_written_out(write: Write) -> None:
    tables = ["[start]\ny_mm = 1.0\nx_mm = 2.0\n", "[moves]\nactions = 9\n", "[learner]\nalpha = 0.3\n"]
    hashes = {
        definition_sha256(load(write('name = "mine"\n' + "".join(order)))) for order in itertools.permutations(tables)
    }
    hashes.add(definition_sha256(load(write('name = "mine"\nstart = {x_mm = 2, y_mm = 1}\n'))))
    assert len(hashes) == 1
    assert re.fullmatch(r"[0-9a-f]{64}", hashes.pop())


def changed(value: object) -> object | None:
    """Another value of the same type that fits every key."""
    if isinstance(value, float):
        return value + 2**-40
    return value + 1 if isinstance(value, int) else None


def test_the_hash_changes_with_every_number_of_a_definition() -> None:
    base = Definition(name="mine")
    seen = {definition_sha256(base)}
    count = 1
    for part in base.__struct_fields__:
        table = getattr(base, part)
        if not isinstance(table, msgspec.Struct):
            continue
        for name in table.__struct_fields__:
            other = changed(getattr(table, name))
            if other is not None:
                changed_table = msgspec.structs.replace(table, **{name: other})
                seen.add(definition_sha256(msgspec.structs.replace(base, **{part: changed_table})))
                count += 1
    assert count > 40
    assert len(seen) == count


@pytest.mark.parametrize(
    "override",
    [
        "name=yours",
        "title=t",
        "source=s",
        "episodes=5",
        "parts.shape=square",
        "policy.kind=greedy",
        "reward.kind=force_change",
        "learner.kind=sarsa",
        "classifier.encoding=split",
        "classifier.when_full=refuse",
    ],
)
def test_the_hash_changes_with_every_word_of_a_definition(override: str) -> None:
    name = "chamfered-q-softmax"
    assert definition_sha256(load(name, [override])) != definition_sha256(load(name))


def test_kinds_with_the_same_numbers_have_different_hashes() -> None:
    one = Definition(name="mine", policy=EpsilonGreedy(epsilon=0.1))
    other = Definition(name="mine", policy=EpsilonAnnealed(mu=0.1))
    assert definition_sha256(one) != definition_sha256(other)
    assert definition_sha256(Definition(name="m", policy=Greedy())) != definition_sha256(Definition(name="m"))


def test_a_run_is_named_by_definition_and_seed() -> None:
    definition = Definition(name="mine")
    assert run_id(definition, 12) == f"{definition_sha256(definition)[:16]}-s12"
    other = Definition(name="mine", start=Start(x_mm=1.7))
    assert len({run_id(one, seed) for one in (definition, other) for seed in (0, 1, 10)}) == 6
    assert [seed_of(run_id(definition, 12)), seed_of(run_id(definition, 2**63 - 1, "ab" * 32))] == [12, 2**63 - 1]
    assert [seed_of(name) for name in ("", "lab-s5", "2adc2fda3e14bee3-s5-more", "2adc2fda3e14bee3-s5x")] == [None] * 4


def test_a_run_from_before_truncation_could_be_chosen_keeps_its_name() -> None:
    assert run_id(load("initial"), 0) == "2adc2fda3e14bee3-s0"
    assert run_id(load("initial", ("limits.truncation=untaught",)), 0) != "2adc2fda3e14bee3-s0"


@pytest.mark.parametrize("learner", [QLearning(), FeltModel()])
def test_a_key_that_came_later_is_left_out_of_the_hash_where_it_says_what_was_done_before(
    learner: LearnerSettings,
) -> None:
    before = Definition(name="mine", limits=Limits(truncation="terminal"), learner=learner)
    fields = msgspec.to_builtins(before)
    others = {"learner." + name for kind in (QLearning, FeltModel) for name in kind.__struct_fields__}
    mine = {"learner." + name for name in learner.__struct_fields__}
    for key, value in _LATER.items():
        if key in others - mine:
            continue
        table, _, name = key.rpartition(".")
        assert (fields[table] if table else fields).pop(name) == value, key
    assert definition_sha256(before) == hashlib.sha256(msgspec.json.encode(fields, order="sorted")).hexdigest()


def test_a_run_from_before_windows_of_samples_keeps_its_name() -> None:
    assert run_id(load("initial", ("sensor.window=1", "sensor.rate_hz=0")), 0) == "2adc2fda3e14bee3-s0"
    assert run_id(load("initial", ("sensor.window=2",)), 0) != "2adc2fda3e14bee3-s0"
