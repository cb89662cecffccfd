"""``python -m services.classifier``: one classifier process."""

from __future__ import annotations

import sys

from services.bus import command
from services.classifier.service import serve


def main() -> None:
    """Parse the command line and serve."""
    serve(command.options(command.parser("classifier", __doc__).parse_args()))


if __name__ == "__main__":
    sys.exit(command.run("classifier", main))
