"""A run as a LeRobotDataset, layout v3.0: one frame a decision, without LeRobot itself.

``observation.state`` is what was felt, ``action`` the increment that was decided for. A dataset has one rate, decisions
have none, so that ``timestamp`` counts them at ``FPS``. Episodes without a decision are left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.export.source import Source
from experiments.export.steps import EpisodeRows, Row

VERSION = "v3.0"
FPS = 10
CHUNKS, DATA_MB, VIDEO_MB = 1000, 100, 200
WRENCH = ["force_x_n", "force_y_n", "force_z_n", "torque_x_nm", "torque_y_nm", "torque_z_nm"]
MOVE = ["move_x_mm", "move_y_mm", "move_z_mm", "turn_x_deg", "turn_y_deg", "turn_z_deg"]
FEATURES: dict[str, dict[str, Any]] = {
    "observation.state": {"dtype": "float32", "shape": [6], "names": WRENCH},
    "action": {"dtype": "float32", "shape": [6], "names": MOVE},
    "next.reward": {"dtype": "float32", "shape": [1], "names": None},
    "next.done": {"dtype": "bool", "shape": [1], "names": None},
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}
TYPES = {"float32": pa.float32(), "bool": pa.bool_(), "int64": pa.int64()}
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Columns = dict[str, npt.NDArray[Any]]


def write(path: Path, source: Source, episodes: Iterable[EpisodeRows]) -> int:
    """Write the folder and return its frames. All of the run is kept in memory: some 100 bytes a frame."""
    task = f"{source.definition.title or source.definition.name}: put the peg into the hole by feel"
    parts, table = list[Columns](), list[dict[str, Any]]()
    begun = 0
    for number, rows in enumerate(_decided(episodes)):
        parts.append(_columns(rows, number, begun))
        table.append(_about(parts[-1], number, begun, task, rows[0].episode))
        begun += len(rows)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in FEATURES} if parts else {}
    data = path / DATA.format(chunk_index=0, file_index=0)
    for file in (data, path / EPISODES):
        file.parent.mkdir(parents=True)
    if whole:
        _write_data(data, whole)
        pq.write_table(pa.Table.from_pylist(table), path / EPISODES)
    _write_tasks(path / "meta" / "tasks.parquet", task)
    _write_json(path / "meta" / "stats.json", {name: _statistics(values) for name, values in whole.items()})
    _write_json(path / "meta" / "info.json", _info(len(table), begun))
    return begun


def _decided(episodes: Iterable[EpisodeRows]) -> Iterator[list[Row]]:
    for episode in episodes:
        rows = [row for row in episode.rows if row.decided]
        if rows:
            yield rows


def _columns(rows: list[Row], number: int, begun: int) -> Columns:
    """Return an episode's frames by feature, as many rows each."""
    count = len(rows)
    frames = np.arange(count)
    return {
        "observation.state": np.array([(*(row.force_n or ()), *(row.torque_nm or ())) for row in rows], np.float32),
        "action": np.array([row.increment for row in rows], np.float32),
        "next.reward": np.array([row.reward or 0.0 for row in rows], np.float32),
        "next.done": frames == count - 1,
        "timestamp": (frames / FPS).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.full(count, number),
        "index": begun + frames,
        "task_index": np.zeros(count, np.int64),
    }


def _about(columns: Columns, number: int, begun: int, task: str, episode: int) -> dict[str, Any]:
    count = len(columns["index"])
    told: dict[str, Any] = {
        "episode_index": number,
        "tasks": [task],
        "length": count,
        "treenail_episode": episode,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": begun,
        "dataset_to_index": begun + count,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, values in columns.items():
        told |= {f"stats/{name}/{key}": value for key, value in _statistics(values).items()}
    return told


def _statistics(values: npt.NDArray[Any]) -> dict[str, Any]:
    """Return a feature's figures, each a list of as many numbers as the feature has."""
    numbers = values.reshape(len(values), -1).astype(np.float64)
    quantiles = {key: np.quantile(numbers, part, axis=0).tolist() for key, part in _QUANTILES.items()}
    return {
        "min": numbers.min(axis=0).tolist(),
        "max": numbers.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(numbers)],
        **quantiles,
    }


def _write_data(path: Path, whole: Columns) -> None:
    arrays, fields = [], []
    for name, about in FEATURES.items():
        kind, size = TYPES[about["dtype"]], about["shape"][0]
        values = pa.array(whole[name].reshape(-1), type=kind)
        if size > 1:
            kind = pa.list_(kind, size)
            values = pa.FixedSizeListArray.from_arrays(values, size)
        arrays.append(values)
        fields.append(pa.field(name, kind))
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def _write_tasks(path: Path, task: str) -> None:
    """Write the table of tasks, whose index is the task's text, as pandas would."""
    index = "__index_level_0__"
    columns: list[dict[str, str | None]] = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": None, "field_name": index, "pandas_type": "unicode", "numpy_type": "object"},
    ]
    pandas = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [{**column, "metadata": None} for column in columns],
        "pandas_version": "2.2.0",
    }
    schema = pa.schema([("task_index", pa.int64()), (index, pa.string())], metadata={"pandas": json.dumps(pandas)})
    pq.write_table(pa.Table.from_pydict({"task_index": [0], index: [task]}, schema=schema), path)


def _info(episodes: int, frames: int) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": "treenail",
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNKS,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": FPS,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": None,
        "features": {name: {**about, "fps": FPS} for name, about in FEATURES.items()},
    }


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n")
