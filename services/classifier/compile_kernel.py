"""``python -m services.classifier.compile_kernel FOLDER``: ART2's arithmetic as an extension module, for images.

The same source by the same compiler as at run time, so the same bits, but for any processor of the kind, and without
the compiler beside it. Needs numba and a C compiler; the module goes next to ``art2_kernel.py`` where it is installed.
"""

from __future__ import annotations

import sys

from services.classifier import art2_kernel
from services.rules.compiled import build

NAME = "art2_machine_code"
SIGNATURES = {
    "present": "Tuple((i8, i8, f8))(f8[::1], f8[:, ::1], i8, f8[:, :, ::1], f8[::1], f8[::1], f8)",
}
"""What ``art2.py`` calls, with the types that it calls it with."""


if __name__ == "__main__":
    print(build(NAME, art2_kernel, SIGNATURES, sys.argv[1]))
