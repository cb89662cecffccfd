"""Errors of Treenail's contract and shell.

    TreenailError
    +-- DefinitionError        an experiment definition that cannot be used: file, line, key, expected, got
    +-- ContractError          something on the bus that does not follow the contract
    |   +-- WrongTypeError     the encoding names another type, or none
    |   +-- WrongVersionError  the right type in another version
    |   +-- BadPayloadError    names, types, lengths or ranges do not fit
    |   +-- StrangerError      it comes from somebody whose role it is not to say that
    +-- FoldError              a message that a worker's fold cannot take
    |   +-- ForeignRunError    it belongs to another run
    |   +-- GapError           messages before it are missing
    |   +-- DivergedError      the same step came twice with different content
    |   +-- UnusableError      its content cannot be learnt from
    +-- CellError              the cell cannot be joined or used
        +-- RoleTakenError     another process already has this role in this cell
        +-- NotAllowedError    the router would not let us do that
        +-- NoAnswerError      nobody, or nobody able to, answered a query
        +-- RefusedError       a request is refused, for one of the reasons of a Refusal
            +-- SwapError      a swap that cannot be made

A command prints such an error as one line and exits with status 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a command that has only begun knows its errors, and not yet all messages
    from services.wire.messages import Reason


class TreenailError(Exception):
    """Base of all errors that are reported as one line, without a traceback."""


class DefinitionError(TreenailError):
    """An experiment definition that cannot be used."""


class ContractError(TreenailError):
    """Something on the bus that does not follow the contract."""


class WrongTypeError(ContractError):
    """The encoding names another type, or none."""


class WrongVersionError(ContractError):
    """The right type in another version."""


class BadPayloadError(ContractError):
    """Names, types, lengths or ranges do not fit the type."""


class StrangerError(ContractError):
    """It comes from somebody whose role in the cell it is not to say that."""


class FoldError(TreenailError):
    """A message that a worker's fold cannot take."""


class ForeignRunError(FoldError):
    """The message belongs to another run."""


class GapError(FoldError):
    """Messages before this one are missing."""


class DivergedError(FoldError):
    """The same step came twice with different content."""


class UnusableError(FoldError):
    """The message's content cannot be learnt from."""


class CellError(TreenailError):
    """The cell cannot be joined or used."""


class RoleTakenError(CellError):
    """Another process already has this role in this cell."""


class NotAllowedError(CellError):
    """The router would not let us do that, in silence."""


class NoAnswerError(CellError):
    """Nobody, or nobody able to, answered a query."""


class RefusedError(CellError):
    """A request is refused; ``reason`` is the stable word for it in the Refusal that is sent back."""

    reason: Reason = "not_ready"


class SwapError(RefusedError):
    """A swap that cannot be made: unknown, changing nothing, at an episode that has begun, after the run's end."""

    def __init__(self, message: str, reason: Reason = "bad_request") -> None:
        super().__init__(message)
        self.reason = reason
