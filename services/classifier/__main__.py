"""``python -m services.classifier``: one classifier process."""

from __future__ import annotations

import sys

from services.classifier.service import serve
from services.wire import command


def main() -> None:
    """Parse the command line and serve."""
    serve(command.options(command.parser("classifier", __doc__).parse_args()))


if __name__ == "__main__":
    sys.exit(command.run("classifier", main))
