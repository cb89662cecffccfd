"""What is called the same on two arms is the same."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import fields

from services.robot_link.settings import ArmSettings
from services.robot_ur.settings import Settings as UrSettings
from services.ros2.robot_settings import Settings as RosSettings

ARMS = (ArmSettings, UrSettings, RosSettings)


def test_settings_of_one_name_have_one_range_and_one_meaning() -> None:
    said = defaultdict(set)
    for arm in ARMS:
        for field in fields(arm):
            if (made := field.metadata.get("setting")) is not None and made.within is not None:
                said[field.name].add((made.within, made.help))
    assert {"within_mm", "settle_s", "withdraw_mm"} <= set(said)
    assert {name: ways for name, ways in said.items() if len(ways) > 1} == {}
