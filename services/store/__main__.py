"""The queryable store of one cell: checkpoints and journal."""

from __future__ import annotations

from pathlib import Path

from services.bus import command
from services.rules.command_line import whole
from services.rules.settings import add_settings, settings_of
from services.store.retention import RetentionSettings
from services.store.service import MAX_BYTES, serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("store", __doc__)
    parser.add_argument("--file", type=Path, default=Path("store.sqlite"), help="SQLite file")
    add_settings(parser, RetentionSettings())
    parser.add_argument("--max-bytes", type=whole(1, 1 << 50), default=MAX_BYTES, help="largest size of the file")
    arguments = parser.parse_args()
    retention = settings_of(RetentionSettings(), arguments)
    serve(command.options(arguments), arguments.file, retention, arguments.max_bytes)


if __name__ == "__main__":
    command.run("store", main)
