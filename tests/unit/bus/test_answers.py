"""Query parameters: what is a state number and what an F/T vector, and that the rest is refused in one line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.bus.answers import ft_vector, state_number
from services.wire.errors import BadPayloadError
from services.wire.message_base import LARGEST_COMPONENT

COMPONENT = st.floats(-LARGEST_COMPONENT, LARGEST_COMPONENT)


@given(st.tuples(*[COMPONENT] * 6).filter(any))
def test_a_vector_comes_back_exactly(components: tuple[float, ...]) -> None:
    force_n, torque_nm = ft_vector(",".join(map(repr, components)))
    assert (*force_n, *torque_nm) == components


@pytest.mark.parametrize("text", ["1,2,3,4,5,6", " 1, 2.,.3e1 ,+4,5,6", "1e0,2E0,3,4,5,6.0"])
def test_numbers_may_be_written_in_the_usual_ways(text: str) -> None:
    assert ft_vector(text) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


@given(st.text(max_size=40))
def test_anything_else_is_refused_in_one_line(text: str) -> None:
    try:
        force_n, torque_nm = ft_vector(text)
    except BadPayloadError as error:
        assert "\n" not in str(error)
        assert "expected" in str(error)
    else:
        assert any((*force_n, *torque_nm))


@pytest.mark.parametrize(
    "text", ["", "1", "1,2,3,4,5,\u0666", "1,2,3,4,5,0x1", "1;2;3;4;5;6", "1,2,3,4,5,6\n7", "infinity," * 6]
)
def test_these_are_no_vectors(text: str) -> None:
    with pytest.raises(BadPayloadError, match=r"^ft: expected .* got "):
        ft_vector(text)


@pytest.mark.parametrize(("text", "state"), [("0", 0), ("7", 7), ("007", 7), ("999999", 999999)])
def test_a_state_number(text: str, state: int) -> None:
    assert state_number(text) == state


@pytest.mark.parametrize("text", ["", "-1", "+1", "1.0", "1000000", "\u0667", "\u00b2", " 1", "1e3"])
def test_these_are_no_state_numbers(text: str) -> None:
    with pytest.raises(BadPayloadError, match="expected a state number"):
        state_number(text)
