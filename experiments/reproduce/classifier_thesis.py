"""The thesis's numbers on the classifier (4.5.2, 4.6, Tables 4.3 and A.2 to A.11); its drawings are lost."""

from __future__ import annotations

from collections.abc import Mapping

Row = tuple[int, int, int, int, int]

RHO = "\N{GREEK SMALL LETTER RHO}"
"""The vigilance, as it is shown."""
RHOS = (0.90, 0.91, 0.92, 0.93, 0.94, 0.95, 0.96, 0.97, 0.98, 0.99)
QUICK_RHOS = (0.90, 0.93, 0.94, 0.95, 0.99)
CLASSES: Mapping[float, int] = {0.90: 10, 0.93: 18, 0.94: 18, 0.95: 20, 0.99: 104}
"""Number of classes by vigilance, where the text tells it (4.5.2, 4.6)."""
PROBES: Mapping[float, Mapping[int, Row]] = {
    0.90: {1: (1, 1, 1, 1, 1), 1000: (3, 4, 1, 2, 5)},
    0.91: {1: (1, 1, 1, 1, 1), 1000: (3, 4, 1, 2, 7), 3000: (3, 4, 1, 2, 5), 8000: (3, 4, 1, 2, 7)},
    0.92: {1: (1, 1, 1, 1, 1), 1000: (3, 4, 5, 1, 8), 2000: (3, 4, 2, 1, 7)},
    0.93: {1: (1, 1, 1, 1, 1), 1000: (3, 4, 7, 2, 5), 4000: (3, 4, 2, 2, 5), 8000: (3, 4, 2, 2, 11)},
    0.94: {
        1: (1, 1, 1, 1, 1),
        1000: (3, 4, 5, 1, 6),
        2000: (3, 4, 5, 11, 6),
        3000: (3, 4, 5, 1, 6),
        8000: (3, 4, 9, 1, 6),
        9000: (3, 4, 5, 1, 6),
        10000: (3, 4, 5, 1, 12),
        12000: (3, 4, 9, 1, 12),
        14000: (3, 4, 5, 1, 12),
    },
    0.95: {
        1: (1, 1, 1, 1, 1),
        1000: (4, 5, 10, 13, 7),
        2000: (4, 5, 6, 3, 7),
        4000: (4, 5, 6, 1, 7),
        7000: (4, 5, 10, 13, 7),
    },
    0.96: {
        1: (1, 1, 1, 1, 1),
        1000: (4, 5, 11, 13, 7),
        4000: (4, 5, 11, 3, 7),
        5000: (4, 5, 11, 13, 7),
        6000: (4, 5, 11, 1, 7),
        9000: (4, 5, 11, 13, 7),
    },
    0.97: {1: (1, 1, 1, 1, 1), 1000: (4, 5, 12, 16, 6)},
    0.98: {1: (1, 1, 1, 1, 1), 1000: (4, 5, 13, 19, 24), 16000: (4, 5, 13, 19, 6)},
    0.99: {1: (1, 1, 1, 1, 1), 1000: (5, 40, 20, 42, 11), 2000: (5, 40, 20, 37, 11), 11000: (5, 25, 20, 37, 11)},
}
"""Classes of the vectors A to E by vigilance: the presentations (of 1, 1000, 2000 ... 20000) at which a row is new."""
TABLES: Mapping[float, str] = {
    rho: ("4.3 and A.7" if rho == 0.95 else f"A.{number}") for number, rho in enumerate(RHOS, start=2)
}
LAST = 20000
"""Last presentation in the tables."""


def classes_of_probes(rho: float, presentation: int) -> Row:
    """Return the classes of A to E at a presentation."""
    return PROBES[rho][max(begun for begun in PROBES[rho] if begun <= presentation)]
