"""Arithmetic as machine code: made ahead for container images, or by numba when first called. Same bits each way."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function, machine_code: ModuleType | None) -> Function:
    """Return a function as machine code: made ahead, or at the first call and kept where numba may write."""
    if machine_code is not None:
        return cast(Function, getattr(machine_code, function.__name__, function))
    from numba import njit

    try:
        return cast(Function, njit(cache=True, fastmath=False)(function))
    except RuntimeError:  # neither beside the file nor at home, as in a read-only installation: compiled at each start
        return cast(Function, njit(fastmath=False)(function))
