"""``python -m services.agent.compile_kernel FOLDER``: the felt model's arithmetic as an extension module, for images.

The same source by the same compiler as at run time, so the same bits, but for any processor of the kind, and without
the compiler beside it. Needs numba and a C compiler; the module goes next to ``felt_kernel.py`` where it is installed.
"""

from __future__ import annotations

import sys
import warnings

from numba.core.errors import NumbaPendingDeprecationWarning

NAME = "felt_machine_code"
SIGNATURES = {
    "judge": "void(f8[::1], f8, i8[::1], f8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, ::1])",
    "fit": "void(f8[::1], f8, f8, f8, f8, f8, f8[::1], f8[:, ::1])",
}
"""What ``felt.py`` calls, with the types that it calls it with."""


def build(folder: str) -> str:
    """Write the extension module into ``folder`` and return its path."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)  # its successor is not there yet
        from numba.pycc import CC  # type: ignore[attr-defined]
    from services.agent import felt_kernel

    compiler = CC(NAME)  # type: ignore[no-untyped-call]
    compiler.output_dir = folder
    for name, signature in SIGNATURES.items():
        compiler.export(name, signature)(getattr(felt_kernel, name).py_func)  # type: ignore[no-untyped-call]
    compiler.compile()
    return str(compiler.output_file)


if __name__ == "__main__":
    print(build(sys.argv[1]))
