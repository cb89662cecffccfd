"""A dataclass's fields are options: read strictly, and what they say comes back as the same settings."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from services.rules.command_line import Parser
from services.rules.settings import add_settings, check, setting, settings_of


@dataclass(frozen=True, slots=True)
class Oven:
    name: str
    degrees: float = setting(180.0, "how hot", within=(50.0, 250.0))
    trays: int | None = setting(None, "how many (default: all)", "--only", within=(1, 4))
    fan: bool = setting(True, "still air", "--no-fan")
    grill: bool = setting(False, "from above")
    kind: str = setting("gas", "what it burns", choices=("gas", "wood"))
    slots: int = setting(3, within=(1, 9))

    def __post_init__(self) -> None:
        check(self, ValueError, "oven: ")


def parsed(*words: str, usual: Oven) -> Oven:
    parser = Parser(prog="oven")
    add_settings(parser, usual)
    return settings_of(usual, parser.parse_args(words))


def test_what_is_not_said_is_as_usual() -> None:
    usual = Oven("a", degrees=90.0, slots=4)
    assert parsed(usual=usual) == usual


def test_what_is_said_is_in_the_settings() -> None:
    words = ("--degrees", "1e2", "--only", "4", "--no-fan", "--grill", "--kind", "wood")
    assert parsed(*words, usual=Oven("a")) == Oven("a", 100.0, 4, False, True, "wood")


def test_the_help_has_range_and_default() -> None:
    parser = Parser(prog="oven")
    add_settings(parser, Oven("a"))
    said = " ".join(parser.format_help().split())
    assert "how hot, from 50 to 250 (default: 180.0)" in said
    assert "how many, from 1 to 4 (default: all)" in said
    assert "--slots" not in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--degrees", "300"), "argument --degrees: expected from 50 to 250, got '300'"),
        (("--only", "2.5"), "argument --only: expected a whole number from 1 to 4, got '2.5'"),
        (("--kind", "coal"), "argument --kind: expected one of gas, wood, got 'coal'"),
    ],
)
def test_a_wrong_word_is_one_line(capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str) -> None:
    with pytest.raises(SystemExit) as end:
        parsed(*words, usual=Oven("a"))
    (line,) = capsys.readouterr().err.splitlines()
    assert end.value.code == 2 and said in line


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"degrees": float("nan")}, "oven: degrees: expected from 50 to 250, got nan"),
        ({"trays": 5}, "oven: trays: expected from 1 to 4, got 5"),
        ({"kind": "coal"}, "oven: kind: expected one of gas, wood, got coal"),
        ({"slots": 0}, "oven: slots: expected from 1 to 9, got 0"),
    ],
)
def test_what_cannot_be_is_refused_without_a_command_line_too(wrong: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=f"^{said}$"):
        Oven("a", **wrong)  # type: ignore[arg-type]
