"""``python -m services.agent.compile_kernel FOLDER``: the felt model's arithmetic as an extension module, for images.

The same source by the same compiler as at run time, so the same bits, but for any processor of the kind, and without
the compiler beside it. Needs numba and a C compiler; the module goes next to ``felt_kernel.py`` where it is installed.
"""

from __future__ import annotations

import sys

from services.agent import felt_kernel
from services.rules.compiled import build

NAME = "felt_machine_code"
SIGNATURES = {
    "judge": "void(f8[::1], f8, i8[::1], f8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, ::1])",
    "fit": "void(f8[::1], f8, f8, f8, f8, f8, f8[::1], f8[:, ::1])",
}
"""What ``felt.py`` calls, with the types that it calls it with."""


if __name__ == "__main__":
    print(build(NAME, felt_kernel, SIGNATURES, sys.argv[1]))
