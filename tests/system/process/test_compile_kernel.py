"""The kernels compiled ahead, for images without the compiler, give the bits of those compiled at run time."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

LEARN = """
import sys
import numpy as np
from services.wire.definition import Art2Settings
for path in sys.argv[1:]:
    import services.classifier
    services.classifier.__path__.append(path)
from services.classifier import art2_kernel
from services.classifier.art2 import Art2
draw = np.random.default_rng(5)
for settings in (Art2Settings(), Art2Settings(rho=0.99, encoding="split", when_full="nearest", capacity=20)):
    network = Art2(settings)
    answers = [network.learn(draw.normal(size=3), 0.1 * draw.normal(size=3)) for _ in range(400)]
    print(network.digest(), sum(answer.state for answer in answers), sum(answer.match for answer in answers))
print("numba" in sys.modules, file=sys.stderr)
"""
FEEL = """
import sys
import numpy as np
for path in sys.argv[1:]:
    import services.agent
    services.agent.__path__.append(path)
from services.agent.felt import FeltLearner
from services.rules.plugins import Lesson
from services.rules.wrench import Wrench
from services.wire.definition import FeltModel, Moves, Thompson
draw, previous, decided = np.random.default_rng(5), None, []
subject = FeltLearner(Moves(), FeltModel(drift=0.001), Thompson(), 3)
for step in range(2000):
    fx, fy, fz, tx, ty, tz = draw.normal(size=6).tolist()
    felt = Wrench((fx, fy, fz), (tx, ty, tz))
    decided.append(subject.decide_felt(previous, step % 7, felt, 0, step))
    previous = Lesson(step % 7, decided[-1], fx - fy, felt)
print(subject.digest(), sum(decided))
print("numba" in sys.modules, file=sys.stderr)
"""


def learn(program: str, *folders: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, folders)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
@pytest.mark.parametrize(("service", "program"), [("classifier", LEARN), ("agent", FEEL)])
def test_the_kernel_made_ahead_gives_the_same_bits_without_a_compiler(
    tmp_path: Path, service: str, program: str
) -> None:
    build = [sys.executable, "-m", f"services.{service}.compile_kernel", str(tmp_path)]
    subprocess.run(build, check=True, capture_output=True)
    made_ahead, at_run_time = learn(program, tmp_path), learn(program)
    assert made_ahead.stdout == at_run_time.stdout
    assert (made_ahead.stderr.strip(), at_run_time.stderr.strip()) == ("False", "True")
