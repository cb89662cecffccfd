"""The recipes of CONTRIBUTING.md, followed word for word in a copy of the tree with an environment of its own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "CONTRIBUTING.md").read_text()
BLOCK = re.compile(r"(?:`([\w./-]+)`:\n\n)?^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NOT_COPIED = shutil.ignore_patterns(
    ".*_cache", ".git", ".hypothesis", ".venv", "__pycache__", "runs", "report", "build"
)


class Step(NamedTuple):
    """One block of a recipe: commands, changes of a file, or a new file."""

    path: str
    kind: str
    text: str

    def follow(self, tree: Path) -> None:
        path = tree / self.path
        if self.kind == "sh":
            shell(tree, self.text)
        elif self.kind == "diff":
            path.write_text(changed(path.read_text(), self.text))
        else:
            assert self.path and not path.exists()
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.text)


RECIPES = {
    title.partition("\n")[0]: [Step(*block) for block in BLOCK.findall(title)]
    for title in re.split(r"^## ", PAGE, flags=re.MULTILINE)
    if title.startswith("Add ")
}


def changed(text: str, diff: str) -> str:
    """Return a text with the changes of a diff, whose parts are divided by @@; each must fit in one place."""
    for part in re.split(r"^@@\n", diff, flags=re.MULTILINE):
        lines = part.splitlines(keepends=True)
        before = "".join(line[1:] or "\n" for line in lines if line[0] != "+")
        after = "".join(line[1:] or "\n" for line in lines if line[0] != "-")
        assert ("\n" + text).count("\n" + before) == 1, f"expected once:\n{before}"
        text = ("\n" + text).replace("\n" + before, "\n" + after)[1:]
    return text


def shell(tree: Path, commands: str) -> None:
    path = f"{tree / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    words = ["bash", "-euo", "pipefail", "-c", commands]
    environment = {**os.environ, "PATH": path, "PYTHON": sys.executable}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(words, cwd=tree, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{commands}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository, in whose .venv is what this interpreter has, and the copy in place of the original."""
    copy = tmp_path_factory.mktemp("copy") / "treenail"
    shutil.copytree(ROOT, copy, ignore=NOT_COPIED)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(copy / ".venv")], check=True)
    (site,) = (copy / ".venv" / "lib").glob("python*/site-packages")
    others = [path for path in sys.path if any(Path(path).glob("*.dist-info"))]
    (site / "others.pth").write_text("\n".join(others) + "\n")
    for name in ("pip", "pytest", "mypy", "ruff", "lint-imports"):
        program, own = Path(sys.executable).with_name(name), copy / ".venv" / "bin" / name
        first, _, rest = program.read_bytes().partition(b"\n")
        if first.startswith(b"#!"):
            own.write_bytes(f"#!{copy / '.venv' / 'bin' / 'python'}\n".encode() + rest)
            own.chmod(0o755)
        else:
            own.symlink_to(program)
    shell(copy, "pip install --quiet --no-deps --no-build-isolation --editable . && touch .venv/ready")
    return copy


def test_there_are_four_recipes_of_some_steps() -> None:
    assert list(RECIPES) == ["Add an experiment", "Add a learner", "Add a message", "Add a service"]
    assert all(len(steps) >= 2 and steps[-1].kind == "sh" for steps in RECIPES.values())


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("title", RECIPES)
def test_a_recipe_works_as_it_is_written(tree: Path, title: str) -> None:
    """One after the other in the same tree: they do not get in each other's way either."""
    for step in RECIPES[title]:
        step.follow(tree)
