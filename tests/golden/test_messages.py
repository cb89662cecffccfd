"""The wire format, byte by byte: a change here breaks every peer and every stored run, so VERSION must go up."""

from __future__ import annotations

import pytest

from experiments.fuzz.golden import Golden, golden
from services.wire.codec import decode, decode_any, encode, encoding_of
from services.wire.messages import MESSAGES

ROWS = [pytest.param(row, id=f"{number}-{row.encoding.split('.')[1]}") for number, row in enumerate(golden())]


def test_the_table_is_complete() -> None:
    assert {row.encoding for row in golden()} == {encoding_of(kind) for kind in MESSAGES}


@pytest.mark.parametrize("row", ROWS)
def test_a_message_becomes_these_bytes(row: Golden) -> None:
    assert encode(row.message).hex() == row.payload


@pytest.mark.parametrize("row", ROWS)
def test_these_bytes_become_the_message(row: Golden) -> None:
    payload, message = bytes.fromhex(row.payload), row.message
    assert decode(type(message), payload, row.encoding) == message
    assert decode_any(payload, row.encoding) == message
    assert repr(decode_any(payload, row.encoding)) == repr(message)  # also the sign of zero
