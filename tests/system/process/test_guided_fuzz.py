"""A short search guided by branch coverage: it gets deeper than sound inputs do, and finds nothing."""

from __future__ import annotations

import pytest

from experiments.fuzz import guided


@pytest.mark.skipif(not guided.available(), reason="atheris has no wheel for this Python or machine")
@pytest.mark.parametrize("reader", ["definition file", "skill"])
def test_a_search_guided_by_coverage_reaches_more_branches(reader: str) -> None:
    (found,) = guided.run_all(4000, reader)
    assert not found.failure
    assert found.inputs >= 4000
    before, after = found.branches
    assert after > before
