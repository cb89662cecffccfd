"""The queryable store of one cell: checkpoints and journal."""

from __future__ import annotations

from pathlib import Path

from services.bus import command
from services.store.retention import RetentionSettings
from services.store.service import MAX_BYTES, serve


def main() -> None:
    """Parse the command line and serve."""
    keep = RetentionSettings()
    parser = command.parser("store", __doc__)
    parser.add_argument("--file", type=Path, default=Path("store.sqlite"), help="SQLite file")
    parser.add_argument("--keep-checkpoints", type=int, default=keep.checkpoints, help="newest checkpoints per worker")
    parser.add_argument("--keep-episodes", type=int, default=keep.journal_episodes, help="journal episodes per run")
    parser.add_argument("--keep-runs", type=int, default=keep.runs, help="newest runs")
    parser.add_argument("--max-bytes", type=int, default=MAX_BYTES, help=f"largest size of the file ({MAX_BYTES})")
    arguments = parser.parse_args()
    try:
        retention = RetentionSettings(arguments.keep_checkpoints, arguments.keep_episodes, arguments.keep_runs)
    except ValueError as error:
        parser.error(str(error))
    serve(command.options(arguments), arguments.file, retention, arguments.max_bytes)


if __name__ == "__main__":
    command.run("store", main)
