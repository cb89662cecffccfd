"""What the commands print on."""

from __future__ import annotations

from rich.console import Console


def console() -> Console:
    """Return a console that does not break tables when it is not a terminal."""
    made = Console()
    return made if made.is_terminal else Console(width=160)
