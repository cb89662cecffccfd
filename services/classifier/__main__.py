"""One classifier process: F/T vectors to contact states (ART2)."""

from __future__ import annotations

from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    options = command.options(command.parser("classifier", __doc__).parse_args())
    from services.classifier.service import serve  # here: what is missing, or Ctrl-C meanwhile, is one line

    serve(options)


if __name__ == "__main__":
    command.run("classifier", main)
