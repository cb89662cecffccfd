"""Arithmetic as machine code: made ahead for container images, or by numba when first called. Same bits each way."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
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


def build(name: str, kernel: ModuleType, signatures: Mapping[str, str], folder: str) -> str:
    """Write functions of ``kernel`` as the extension module ``name`` into ``folder`` and return its path.

    ``signatures`` says with which types each is called, in numba's words. Needs numba and a C compiler.
    """
    from numba.core.errors import NumbaPendingDeprecationWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)  # its successor is not there yet
        from numba.pycc import CC  # type: ignore[attr-defined]

    compiler = CC(name)  # type: ignore[no-untyped-call]
    compiler.output_dir = folder
    for function, signature in signatures.items():
        compiler.export(function, signature)(getattr(kernel, function).py_func)  # type: ignore[no-untyped-call]
    compiler.compile()
    return str(compiler.output_file)
