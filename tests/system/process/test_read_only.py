"""An installation that cannot be written to, and a user without a home: the classifier works all the same."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def test_the_classifier_works_where_nothing_can_be_kept(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "services", tmp_path / "services", ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    (tmp_path / "services/classifier/__pycache__").touch()  # a file: no folder can be made, not even by root
    ask = "from services.classifier import art2_kernel as k; import numpy; print(k.norm_of(numpy.array([3.0, 4.0])))"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "HOME": "/proc/nonexistent"}
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-B", "-c", ask], cwd="/", env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout == "5.0\n", done.stderr
