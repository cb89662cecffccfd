"""What a cell says of a felt model when it is asked what it would do, and how a person reads it."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from experiments.lab.in_process import InProcessRun
from services.agent.service import policy, q_table, with_opinion
from services.wire.definition_file import load
from services.wire.errors import BadPayloadError
from services.wire.messages import PolicyAnswer, QTable
from treenail.commands import policy as policy_command
from treenail.commands import q_table as q_table_command

FORCE, TORQUE = (-0.3, 0.34, -0.74), (-0.037, -0.033, 0.0)


@pytest.fixture(scope="module")
def worker() -> Any:
    definition = load("suite-round")
    run = InProcessRun(definition, 31)
    list(run.episodes(5))
    return SimpleNamespace(fold=run.agent, experiment=SimpleNamespace(definition=definition))


def shown(table: Any, width: int = 80) -> str:
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


def felt(worker: Any, state: int | None = 0) -> PolicyAnswer:
    return with_opinion(worker.fold, policy(worker, state, 0.97), FORCE, TORQUE)


def test_a_value_is_what_a_move_earns_at_once_and_what_comes_after_it(worker: Any) -> None:
    answer = felt(worker)
    assert not answer.partial
    assert answer.table == tuple(worker.fold.learner.values(0).tolist())
    sums = [model + table for model, table in zip(answer.model, answer.table, strict=True)]
    assert list(answer.values) == pytest.approx(sums)
    assert answer.best_action == max(range(9), key=answer.values.__getitem__)
    assert sum(answer.probabilities) == pytest.approx(1.0)
    assert min(answer.deviations) > 0.0


def test_it_speaks_for_a_wrench_that_fits_no_state(worker: Any) -> None:
    answer = felt(worker, None)
    assert answer.state is None and not answer.known
    assert set(answer.table) == {0.0} and set(answer.model) != {0.0}


def test_asked_is_nothing_learnt(worker: Any) -> None:
    before = worker.fold.learner.digest()
    assert felt(worker) == felt(worker)
    assert worker.fold.learner.digest() == before


def test_what_cannot_be_felt_is_refused(worker: Any) -> None:
    with pytest.raises(BadPayloadError, match=r"^ft: force and torque"):
        with_opinion(worker.fold, policy(worker, 0, 0.9), FORCE, (1e5, 0.0, 0.0))


def test_a_person_sees_the_parts_in_80_columns(worker: Any) -> None:
    text = shown(policy_command.table(felt(worker)))
    assert all(heading in text for heading in ("at once", "+-", "after it", "probability", "visits"))
    assert max(map(len, text.splitlines())) <= 80
    assert "--ft" not in policy_command.title(felt(worker))


def test_of_a_state_alone_only_a_part_is_known_and_that_is_said(worker: Any) -> None:
    answer = policy(worker, 0, None)
    assert answer.partial and not answer.model
    assert "ask with --ft" in policy_command.title(answer)
    assert "at once" not in shown(policy_command.table(answer))


def test_the_q_table_says_that_it_is_a_part(worker: Any) -> None:
    table = q_table(worker)
    assert table.partial
    assert "felt model's part" in shown(q_table_command.table(table), 140)


def test_of_a_table_nothing_of_it_is_said() -> None:
    definition = load("initial")
    run = InProcessRun(definition, 31)
    list(run.episodes(1))
    worker: Any = SimpleNamespace(fold=run.agent, experiment=SimpleNamespace(definition=definition))
    table: QTable = q_table(worker)
    assert not table.partial and "felt" not in shown(q_table_command.table(table), 140)
    answer = with_opinion(run.agent, policy(worker, 0, 0.9), FORCE, TORQUE)
    assert answer == policy(worker, 0, 0.9)
    assert "at once" not in shown(policy_command.table(answer))
