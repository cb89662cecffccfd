"""What comes in is data: nothing in Treenail turns bytes or text from elsewhere into code, objects or shell commands.

Where code is loaded by a name, the name is ours: a literal, one of a fixed table, or that of an installed package.

Two uses of pickle remain that are not ours to read. Processes that the experiments start for themselves talk to their
parent through multiprocessing's pipes, which pickle; such a pipe is an unnamed pair of sockets between a parent and the
child that it has started, nobody else can open it, and it ends with either. So multiprocessing may be imported by
``experiments`` alone, and nothing of it that listens for others. And numba keeps compiled kernels in its cache on disk,
beside the code that it was compiled from: whoever can write there can write the code itself.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NO_MODULES = {
    "_pickle",
    "cloudpickle",
    "code",
    "codeop",
    "dbm",
    "dill",
    "joblib",
    "jsonpickle",
    "marshal",
    "pickle",
    "ruamel",
    "runpy",
    "shelve",
    "yaml",
}
NO_BUILTINS = {"__import__", "compile", "eval", "exec"}
NO_CALLS = {"os.popen", "os.system", "numpy.load", "np.load", "subprocess.getoutput", "subprocess.getstatusoutput"}
NO_LISTENERS = {"Client", "Listener", "Manager", "managers", "SyncManager", "BaseManager", "shared_memory"}
NO_OPTIONS = {"allow_pickle", "shell"}
PLUGINS = "services/rules/plugins.py"
"""The only one that looks for installed packages' entry points."""


def sources() -> dict[str, str]:
    """Return all modules of the software, by path."""
    paths = (path for part in ("services", "experiments", "treenail") for path in sorted((ROOT / part).rglob("*.py")))
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}


def complaints(where: str, text: str) -> list[str]:
    """Return what must not be in a module's source."""
    found = [
        f"{where}:{getattr(node, 'lineno', 0)}: {what}"
        for node in ast.walk(ast.parse(text))
        for what in (*_imports(where, node), *_calls(where, node))
    ]
    return sorted(found)


def _imports(where: str, node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        names = [(alias.name, "") for alias in node.names]
    elif isinstance(node, ast.ImportFrom):
        names = [(node.module or "", alias.name) for alias in node.names]
    else:
        return
    for module, name in names:
        first, *rest = module.split(".")
        if first in NO_MODULES:
            yield f"import of {module}"
        if first == "multiprocessing" and (where.startswith("services/") or {*rest, name} & NO_LISTENERS):
            yield f"import of {module} {name}".rstrip()
        if name == "entry_points" and where != PLUGINS:
            yield "entry points"


def _calls(where: str, node: ast.AST) -> Iterator[str]:
    if not isinstance(node, ast.Call):
        return
    name = ast.unparse(node.func)
    if name in NO_BUILTINS or name in NO_CALLS:
        yield f"call of {name}"
    if name.rpartition(".")[2] == "import_module":
        given = node.args[0] if node.args else None
        if not (isinstance(given, ast.Constant) or (isinstance(given, ast.Name) and given.id.isupper())):
            yield "import of a module by a name that is not written there"
    for option in node.keywords:
        unset = isinstance(option.value, ast.Constant) and option.value.value is False
        if option.arg in NO_OPTIONS and not unset:
            yield f"option {option.arg} of {name}"


def test_no_module_turns_data_into_code() -> None:
    assert [complaint for where, text in sources().items() for complaint in complaints(where, text)] == []


def test_all_of_the_software_is_looked_at() -> None:
    known = set(sources())
    assert {"services/wire/codec.py", "services/store/database.py", "experiments/lab/pool.py"} <= known
    assert len(known) > 100


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "import os, pickle as p",
        "from pickle import loads",
        "from yaml import safe_load",
        "import multiprocessing",
        "from multiprocessing import connection",
        "def f():\n    import marshal",
        "eval(text)",
        "exec(text)",
        "compile(text, '', 'exec')",
        "__import__(name)",
        "import_module(name)",
        "importlib.import_module(f'services.{name}')",
        "os.system('ls')",
        "subprocess.run('ls', shell=True)",
        "subprocess.run('ls', shell=wanted)",
        "np.load(path)",
        "numpy.lib.format.read_array(file, allow_pickle=True)",
        "from importlib.metadata import entry_points",
    ],
)
def test_code_in_data_would_be_noticed(text: str) -> None:
    assert len(complaints("services/agent/learning.py", text)) == 1


@pytest.mark.parametrize("text", ["from multiprocessing.connection import Listener", "import multiprocessing.managers"])
def test_nobody_listens_for_pickles(text: str) -> None:
    assert len(complaints("experiments/lab/run.py", text)) == 1
    assert complaints("experiments/lab/run.py", "import multiprocessing") == []


@pytest.mark.parametrize(
    "text",
    ["re.compile('a')", "import_module('x')", "subprocess.run(['ls'], shell=False)", "json.loads(text)", "s.load(f)"],
)
def test_what_is_harmless_is_let_be(text: str) -> None:
    assert complaints("services/agent/learning.py", text) == []
