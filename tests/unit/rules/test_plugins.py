"""Plug-ins are found by entry point only, and whatever is wrong with one is said in a line."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.rules import plugins
from services.rules.plugins import PluginError
from services.wire.definition import Art2Settings, Definition, Plugin, QLearning
from services.wire.definition_file import definition_sha256, load
from services.wire.errors import DefinitionError


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an installed package that registers what its module has."""
    (tmp_path / "odd_plugins-1.dist-info").mkdir()
    (tmp_path / "odd_plugins-1.dist-info" / "METADATA").write_text("Name: odd-plugins\nVersion: 1\n")
    points = ("[treenail.classifiers]", "missing = odd_plugins_gone:X", "broken = odd_plugins_broken:X")
    text = "\n".join([*points, "picky = odd_plugins:Picky", ""])
    (tmp_path / "odd_plugins-1.dist-info" / "entry_points.txt").write_text(text)
    (tmp_path / "odd_plugins_broken.py").write_text("1 / 0\n")
    refusal = "        raise ValueError(f'expected a colour, got {settings}')"
    lines = ("class Picky:", "    def __init__(self, settings):", refusal)
    (tmp_path / "odd_plugins.py").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_the_shipped_ones_are_installed() -> None:
    assert {"fuzzy-art", "art2a"} <= set(plugins.installed(plugins.CLASSIFIERS))
    assert "srv" in plugins.installed(plugins.LEARNERS)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("nobody", r"classifier.name: expected one of .*fuzzy-art.*, got 'nobody'; is its package installed\?"),
        ("missing", "classifier 'missing': odd_plugins_gone:X cannot be loaded: ModuleNotFoundError"),
        ("broken", "classifier 'broken': .* cannot be loaded: ZeroDivisionError"),
        ("picky", "classifier 'picky': settings: ValueError: expected a colour, got {'a': 1}"),
    ],
)
def test_what_is_wrong_is_said(package: Path, name: str, complaint: str) -> None:
    definition = Definition(name="test", classifier=Plugin(name=name, settings={"a": 1}))
    with pytest.raises(PluginError, match=complaint) as error:
        plugins.check(definition)
    assert "\n" not in str(error.value)


def test_two_packages_with_the_same_name_are_refused(package: Path) -> None:
    other = package / "others-1.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Name: others\nVersion: 1\n")
    (other / "entry_points.txt").write_text("[treenail.classifiers]\npicky = others:Picky\n")
    with pytest.raises(PluginError, match="expected one plug-in named 'picky', got"):
        plugins.installed(plugins.CLASSIFIERS)


def test_a_definition_names_one_and_its_settings_count(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[classifier]\nkind = "plugin"\nname = "fuzzy-art"\nsettings = { rho = 0.8 }\n')
    definition = load(str(path))
    assert definition.classifier == Plugin(name="fuzzy-art", settings={"rho": 0.8})
    other = load(str(path), ["classifier.settings.rho=0.9"])
    assert definition_sha256(other) != definition_sha256(definition)
    with pytest.raises(DefinitionError, match=r"classifier\.name"):
        load(str(path), ["classifier.name=../x"])
    with pytest.raises(DefinitionError, match=r"classifier\.settings"):
        load(str(path), ["classifier.settings.rho=[1]"])


def test_the_usual_kinds_need_not_be_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[classifier]\nrho = 0.9\n[learner]\nalpha = 0.2\n')
    assert load(str(path)) == Definition(name="mine", classifier=Art2Settings(rho=0.9), learner=QLearning(alpha=0.2))
