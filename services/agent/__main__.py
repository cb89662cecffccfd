"""One agent process: contact states to moves (Q-learning, SARSA)."""

from __future__ import annotations

from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    options = command.options(command.parser("agent", __doc__).parse_args())
    from services.agent.service import serve  # here: what is missing, or Ctrl-C meanwhile, is one line

    serve(options)


if __name__ == "__main__":
    command.run("agent", main)
