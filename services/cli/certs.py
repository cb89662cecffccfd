"""``treenail certs``."""

from __future__ import annotations

import argparse

from services.wire.errors import TreenailError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""


def act(arguments: argparse.Namespace) -> None:
    """Not there yet."""
    raise TreenailError("not there yet")
