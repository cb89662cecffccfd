"""Who may do what: complete, in accord with the contract, and what docs/security.md says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus.access import ACCESS, FOR_ALL, NAMES, by_certificate, by_door, may, table, who_may
from services.wire.keys import CLIENTS, CONTRACT, SENSORS, STORED
from treenail.__main__ import SERVICES as COMMANDS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "security.md"


def test_every_key_of_the_contract_has_its_rule_and_there_are_no_others() -> None:
    assert set(ACCESS) == set(CONTRACT) | set(STORED)


def test_every_service_that_can_be_started_can_have_a_certificate() -> None:
    assert set(COMMANDS) <= set(NAMES)


@pytest.mark.parametrize("key", CONTRACT)
def test_the_rule_fits_the_kind_of_key(key: str) -> None:
    row = CONTRACT[key]
    used = {verb for verb, names in row.access._asdict().items() if names}
    if row.kind == "pub":
        assert used == {"put", "hear"} and set(row.to) <= set(row.access.hear)
    elif row.kind == "query":
        assert used == {"ask", "answer"}
    elif row.kind == "put, query":
        stored = STORED[key.partition("/")[0] + "/**"]
        assert stored.answer == ("store",) and "store" in stored.hear
        assert row.access.put and not used & {"answer", "be", "watch"}
    else:
        assert row.kind.startswith("liveliness") and {"be", "watch"} <= used


def _may(verb: str) -> dict[str, set[str]]:
    """Return the keys with which each client may do something."""
    return {name: {key for key, access in ACCESS.items() if name in getattr(access, verb)} for name in CLIENTS}


def test_what_would_be_dangerous_is_for_one_alone() -> None:
    put, ask, answer, delete = _may("put"), _may("ask"), _may("answer"), _may("delete")
    assert [name for name in CLIENTS if "action" in put[name]] == ["agent"]
    assert [name for name in CLIENTS if ask[name] & {"move", "home"}] == ["task"]
    assert set(SENSORS) == {"sim", "sensor_jr3", "sensor_rdt", "robot_ur", "ros2_sensor"}
    assert {name for name in CLIENTS if answer[name] & {"move", "home"}} == {
        "sim",
        "robot_link",
        "robot_ur",
        "ros2_robot",
    }
    assert {name for name in CLIENTS if "ft" in put[name]} == set(SENSORS)
    skills = {"checkpoint/skill/<sha256>", "checkpoint/skill/latest"}
    assert {name for name in CLIENTS if put[name] & skills} == {"task", "operator"}
    assert {key for name in CLIENTS for key in delete[name]} == skills == delete["operator"]


def test_people_and_the_viewer_read_and_a_learner_never_sees_the_truth() -> None:
    put, answer = _may("put"), _may("answer")
    assert put["guest"] == answer["guest"] == answer["operator"] == set()
    assert put["viewer"] == put["ros2_out"] == {"heartbeat/<service>"}
    assert answer["viewer"] == {"alive/<service>"}
    published = {key for key, row in CONTRACT.items() if row.kind == "pub"}
    assert _may("hear")["guest"] == _may("hear")["viewer"] == published | set(STORED)
    for name in ("task", "classifier", "agent"):
        assert "sim/truth" not in _may("hear")[name]


def test_the_router_gets_rules_that_zenoh_understands_and_denies_the_rest() -> None:
    control: Any = by_certificate()
    assert control["default_permission"] == "deny"
    assert {subject["id"] for subject in control["subjects"]} == set(CLIENTS)
    used = [rule for policy in control["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(rule["id"] for rule in control["rules"])
    for rule in control["rules"]:
        assert rule["permission"] == "allow"
        for key in rule["key_exprs"]:
            assert key.startswith("treenail/") or key == FOR_ALL
            assert str(zenoh.KeyExpr(key)) == key


def test_without_certificates_the_door_says_who_is_of_the_cell_and_all_others_are_guests() -> None:
    control: Any = by_door(["eth1"])
    rules = {rule["id"]: rule for rule in control["rules"]}
    subjects = {subject["id"]: subject for subject in control["subjects"]}
    for policy in control["policies"]:
        for subject in policy["subjects"]:
            told = {name: value for name, value in subjects[subject].items() if name != "id"}
            may_put = any(
                "put" in rules[name]["messages"] and "ingress" in rules[name]["flows"] for name in policy["rules"]
            )
            assert may_put == (told in ({"link_protocols": ["unixsock-stream"]}, {"interfaces": ["eth1"]}))
    assert subjects["guest"] == {"id": "guest"}, "whoever comes in"


def test_in_a_domain_of_ros_2_whoever_comes_may_speak_but_not_in_a_cell() -> None:
    control: Any = by_door([], [7])
    (rule,) = (rule for rule in control["rules"] if rule["id"] == "ros2")
    assert {"rules": ["ros2"], "subjects": ["guest"]} in control["policies"]
    keys = [zenoh.KeyExpr(key) for key in rule["key_exprs"]]
    for key, allowed in (("7/a/b/T/h", True), ("@ros2_lv/7/x", True), ("8/a/b/T/h", False), ("treenail/a/ft", False)):
        assert any(one.includes(zenoh.KeyExpr(key)) for one in keys) == allowed


@pytest.mark.parametrize(
    ("name", "verb", "key", "allowed"),
    [
        ("guest", "ask", "agent/q_table", True),
        ("guest", "ask", "agent/policy?state=3", True),
        ("guest", "ask", "swap", False),
        ("operator", "ask", "swap", True),
        ("guest", "ask", "alive/*", True),
        ("guest", "ask", "**", False),
        ("guest", "put", "checkpoint/skill/latest", False),
        ("agent", "put", "heartbeat/agent", True),
        ("agent", "put", "heartbeat/task", False),
        ("guest", "ask", "no//key", False),
    ],
)
def test_what_one_may_is_known_without_asking(name: str, verb: str, key: str, allowed: bool) -> None:
    assert may(name, verb, key) == allowed
    assert (name in who_may(verb, key)) == allowed


def test_the_page_has_the_table() -> None:
    assert table() in PAGE.read_text(encoding="utf-8"), "put what `python -m services.bus.access` prints there"
