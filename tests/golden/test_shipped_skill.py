"""The skill that comes with Treenail is what its command in the Makefile makes, to the byte."""

from __future__ import annotations

import re
from pathlib import Path

from experiments.lab.run import run_seed
from services.rules.shipped_skill import FILE, builtin
from services.rules.skill import file_bytes
from services.wire.definition_file import load

ROOT = Path(__file__).resolve().parents[2]
RECIPE = re.compile(
    r"^skill: setup .*\n"
    r"\t\S+/treenail experiment run (\S+) --set (\S+) --episodes (\d+) --seed-list (\d+) --out (\S+) --force\n"
    r"\tcp (\S+) (\S+)\n",
    re.MULTILINE,
)


def test_it_is_learnt_again_to_the_same_bytes() -> None:
    (recipe,) = RECIPE.findall((ROOT / "Makefile").read_text(encoding="utf-8"))
    name, setting, episodes, seed, out, made, kept = recipe
    assert (made, ROOT / kept) == (f"{out}/seed{seed}.skill", FILE)
    learnt = run_seed(load(name, (setting,)), int(seed), int(episodes), lambda _: None).skill
    assert file_bytes(learnt) == file_bytes(builtin()), "`make skill` makes it again"
