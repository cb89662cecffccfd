"""Every motion of a run as a Parquet file: one row each, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from experiments.export.source import Source
from experiments.export.steps import EpisodeRows, Row
from experiments.lab.result_files import definition_toml
from services.wire.definition_file import definition_sha256

ROWS = 20_000
"""Rows of a group; so many are kept in memory."""
POSE = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
WRENCH = ("force_x_n", "force_y_n", "force_z_n", "torque_x_nm", "torque_y_nm", "torque_z_nm")
MOVE = ("move_x_mm", "move_y_mm", "move_z_mm", "turn_x_deg", "turn_y_deg", "turn_z_deg")
SCHEMA = pa.schema(
    [
        pa.field("episode", pa.int32(), nullable=False),
        pa.field("motion", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("decision", pa.int64()),
        *(pa.field(name, pa.float64()) for name in WRENCH),
        pa.field("state", pa.int32()),
        pa.field("action", pa.int32()),
        pa.field("action_name", pa.string(), nullable=False),
        pa.field("policy_version", pa.int64()),
        pa.field("reward", pa.float64()),
        *(pa.field(f"commanded_{name}", pa.float64(), nullable=False) for name in POSE),
        *(pa.field(name, pa.float64(), nullable=False) for name in MOVE),
        pa.field("outcome", pa.string(), nullable=False),
    ]
)


def write(path: Path, source: Source, episodes: Iterable[EpisodeRows]) -> int:
    """Write the file and return its rows."""
    about = {
        "treenail_run": source.name,
        "treenail_seed": str(source.seed),
        "treenail_definition": definition_toml(source.definition),
        "treenail_definition_sha256": definition_sha256(source.definition),
    }
    count, waiting = 0, list[Row]()
    with pq.ParquetWriter(path, SCHEMA.with_metadata(about), compression="zstd") as writer:
        for episode in episodes:
            waiting += episode.rows
            if len(waiting) >= ROWS:
                count += _put(writer, waiting)
        count += _put(writer, waiting)
    return count


def _put(writer: pq.ParquetWriter, rows: list[Row]) -> int:
    writer.write_table(pa.Table.from_pylist([_plain(row) for row in rows], schema=writer.schema))
    count = len(rows)
    rows.clear()
    return count


def _plain(row: Row) -> dict[str, object]:
    wrench = (None,) * 6 if row.force_n is None or row.torque_nm is None else (*row.force_n, *row.torque_nm)
    return {
        "episode": row.episode,
        "motion": row.motion,
        "time_s": row.t_ns * 1e-9,
        "decision": row.decision,
        **dict(zip(WRENCH, wrench, strict=True)),
        "state": row.state,
        "action": row.action,
        "action_name": row.action_name,
        "policy_version": row.policy_version,
        "reward": row.reward,
        **{f"commanded_{name}": value for name, value in zip(POSE, row.flange, strict=True)},
        **dict(zip(MOVE, row.increment, strict=True)),
        "outcome": row.outcome,
    }
