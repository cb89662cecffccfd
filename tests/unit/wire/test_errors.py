"""The tree of errors: who catches what."""

from __future__ import annotations

import inspect
from typing import get_args

import pytest

from services.wire import errors
from services.wire.messages import Reason

ALL = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)]


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_every_error_is_one_of_treenails_and_says_so_in_its_name(kind: type[Exception]) -> None:
    assert issubclass(kind, errors.TreenailError)
    assert kind.__name__.endswith("Error")
    assert kind.__doc__
    assert str(kind("subject: expected this, got that")) == "subject: expected this, got that"


def test_the_tree_in_the_docstring_is_the_tree() -> None:
    page = inspect.getdoc(errors) or ""
    assert {kind.__name__ for kind in ALL} == {word for word in page.split() if word.endswith("Error")}


def test_the_kinds_of_trouble_do_not_mix() -> None:
    families = (errors.DefinitionError, errors.ContractError, errors.FoldError, errors.CellError)
    for kind in ALL:
        if kind is not errors.TreenailError:
            assert sum(issubclass(kind, family) for family in families) == 1, kind


def test_a_refusal_has_a_reason_of_the_contract() -> None:
    assert errors.RefusedError.reason in get_args(Reason)
