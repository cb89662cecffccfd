"""A run in formats of others: read back by their own readers, the same as its journal, whole or not at all."""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow", reason="the extra export is not installed")
pytest.importorskip("rosbags", reason="the extra export is not installed")

import pyarrow.parquet as pq
from msgspec import structs

from experiments.export import lerobot, mcap, parquet
from experiments.export.aside import ExportError, aside
from experiments.export.source import Source, source
from experiments.export.steps import MOTION_NS, EpisodeRows, Stepper
from experiments.lab import result_files
from experiments.lab.in_process import InProcessRun
from services.rules import results
from services.sim.pose import Pose
from services.task.insertion import Insertion
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, load
from services.wire.errors import CellError, DivergedError, TreenailError
from services.wire.messages import FtPacket, JournalEpisode

SEED, EPISODES = 3, 5
Write = Callable[[Path, Source, Iterable[EpisodeRows]], int]
LEROBOT = "TREENAIL_TEST_LEROBOT"


@pytest.fixture(scope="module")
def definition() -> Definition:
    return load(
        "initial", ["start.height_mm=0.4", "limits.move_limit=40", "limits.success_fraction=0.2", "noise.scale=0"]
    )


@pytest.fixture(scope="module")
def run(definition: Definition) -> InProcessRun:
    return InProcessRun(definition, SEED, remember=True)


@pytest.fixture(scope="module")
def journal(run: InProcessRun) -> list[JournalEpisode]:
    entries = []
    for _ in run.episodes(EPISODES):
        entries.append(run.task.record())
    return entries


@pytest.fixture
def recorded(definition: Definition, run: InProcessRun, journal: list[JournalEpisode]) -> Source:
    return Source("small", definition, SEED, len(journal), iter(journal))


def rows(recorded: Source) -> Iterable[EpisodeRows]:
    return Stepper(recorded.definition, "run", recorded.seed).episodes(recorded.episodes)


def test_every_motion_is_a_row_and_ends_where_the_arm_was_sent(
    recorded: Source, run: InProcessRun, journal: list[JournalEpisode]
) -> None:
    episodes = list(rows(recorded))
    assert [len(episode.rows) for episode in episodes] == [entry.summary.moves for entry in journal if entry.summary]
    for episode, entry in zip(episodes, journal, strict=True):
        decided = [row for row in episode.rows if row.decided]
        assert [(row.motion - 1, row.force_n, row.reward) for row in decided] == [
            (step.step, step.force_n, step.reward) for step in entry.steps
        ]
        assert [row.decision for row in decided] == list(
            range(entry.first_decision, entry.first_decision + len(decided))
        )
        assert [row.outcome for row in episode.rows if row.outcome] == [episode.summary.outcome]
    last = episodes[-1].rows[-1]
    assert last.flange.moved(last.increment) == pytest.approx(run.cell.world.flange, abs=1e-9), "there is no noise"
    times = [row.t_ns for episode in episodes for row in episode.rows]
    assert times[0] == 0 and times == sorted(set(times)) and times[1] == MOTION_NS


def test_an_entry_that_cannot_have_been_is_refused(recorded: Source, journal: list[JournalEpisode]) -> None:
    summary = journal[0].summary
    assert summary is not None
    shorter = structs.replace(journal[0], summary=structs.replace(summary, moves=1))
    with pytest.raises(TreenailError, match="expected decisions in 1 motions, got a decision after motion"):
        list(Stepper(recorded.definition, "run", SEED).episodes([shorter]))


def test_parquet_has_units_in_its_names_and_reads_back(
    tmp_path: Path, recorded: Source, journal: list[JournalEpisode]
) -> None:
    count = parquet.write(tmp_path / "run.parquet", recorded, rows(recorded))
    table = pq.read_table(tmp_path / "run.parquet")
    assert table.num_rows == count == sum(entry.summary.moves for entry in journal if entry.summary)
    assert {"force_x_n", "torque_z_nm", "commanded_x_mm", "turn_x_deg", "time_s"} <= set(table.column_names)
    felt = [row for row in table.to_pylist() if row["decision"] is not None]
    steps = [step for entry in journal for step in entry.steps]
    assert [(row["force_x_n"], row["torque_y_nm"], row["state"], row["reward"]) for row in felt] == [
        (step.force_n[0], step.torque_nm[1], step.state, step.reward) for step in steps
    ]
    about = table.schema.metadata[b"treenail_definition"].decode()
    (tmp_path / "definition.toml").write_text(about)
    assert load(str(tmp_path / "definition.toml")) == recorded.definition


def test_a_bag_is_read_back_by_somebody_elses_reader(
    tmp_path: Path, recorded: Source, journal: list[JournalEpisode]
) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    count = mcap.write(tmp_path / "bag", recorded, rows(recorded))
    by_topic: dict[str, list[object]] = {}
    for message in reader.read_ros2_messages(str(tmp_path / "bag" / "bag.mcap")):
        by_topic.setdefault(message.channel.topic, []).append(message.ros_msg)
    assert sum(map(len, by_topic.values())) == count
    steps = [step for entry in journal for step in entry.steps]
    wrenches = by_topic["/treenail/wrench"]
    assert [wrench.wrench.force.x for wrench in wrenches] == [step.force_n[0] for step in steps]  # type: ignore[attr-defined]
    assert wrenches[0].header.frame_id == "tool"  # type: ignore[attr-defined]
    pose = by_topic["/treenail/pose"][0]
    home = Insertion(recorded.definition, "run", SEED).home(0, 0)
    start = Pose.from_tilt(home.x_mm, home.y_mm, home.z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
    assert pose.pose.position.x == pytest.approx(start.x_mm * 1e-3)  # type: ignore[attr-defined]
    assert pose.pose.orientation.w == pytest.approx(start.qw)  # type: ignore[attr-defined]
    ended = [(one.episode, one.outcome, one.episode_return) for one in by_topic["/treenail/episode"]]  # type: ignore[attr-defined]
    assert ended == [(s.episode, s.outcome, s.episode_return) for entry in journal if (s := entry.summary)]
    assert [one.reward for one in by_topic["/treenail/reward"]] == [  # type: ignore[attr-defined]
        step.reward for step in steps if step.reward is not None
    ]


def test_a_bag_that_is_cut_off_is_noticed_by_its_reader(tmp_path: Path, recorded: Source) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    mcap.write(tmp_path / "bag", recorded, rows(recorded))
    whole = (tmp_path / "bag" / "bag.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(Exception, match=r"(?i)magic|end|eof|footer|expected|exceeds"):
        list(reader.read_ros2_messages(str(tmp_path / "cut.mcap")))


def test_the_layout_of_a_lerobot_dataset(tmp_path: Path, recorded: Source, journal: list[JournalEpisode]) -> None:
    frames = lerobot.write(tmp_path / "set", recorded, rows(recorded))
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_frames"]) == ("v3.0", frames)
    data = pq.read_table(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert data.num_rows == frames and set(data.column_names) == set(info["features"])
    lengths = pq.read_table(tmp_path / "set" / lerobot.EPISODES).column("length").to_pylist()
    assert lengths == [len(entry.steps) for entry in journal if entry.steps] and sum(lengths) == frames
    assert sum(data.column("next.done").to_pylist()) == len(lengths)


def test_lerobot_itself_loads_it(tmp_path: Path, recorded: Source) -> None:
    python = os.environ.get(LEROBOT)
    if not python:
        pytest.skip(f"{LEROBOT} names no Python that has lerobot")
    frames = lerobot.write(tmp_path / "set", recorded, rows(recorded))
    code = (
        "import sys; from lerobot.datasets.lerobot_dataset import LeRobotDataset\n"
        "d = LeRobotDataset('treenail/run', root=sys.argv[1])\n"
        "print(len(d), d[3]['observation.state'].shape[0], d[3]['task'])"
    )
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "home")}
    command = [python, "-c", code, str(tmp_path / "set")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=170, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{frames} 6 ")


def test_a_run_without_a_store_is_made_again(tmp_path: Path, run: InProcessRun, journal: list[JournalEpisode]) -> None:
    summaries = tuple(entry.summary for entry in journal if entry.summary)
    digests: results.Digests = {"q_table": "", "art2": "", "episodes": results.episodes_digest(summaries)}
    done = results.RunResult(SEED, summaries, digests)
    definition = run.record.definition
    told = results.summary(definition, definition_sha256(definition), [done])
    (tmp_path / "run").mkdir()
    result_files.write(tmp_path / "run", definition, told, [done], {})
    with source(argparse.Namespace(run=str(tmp_path / "run"), seed=None, named=None)) as again:
        assert (again.length, again.seed, next(again.episodes).steps) == (EPISODES, SEED, journal[0].steps)
    with (
        pytest.raises(CellError, match=r"--seed: expected one of 3 in "),
        source(argparse.Namespace(run=str(tmp_path / "run"), seed=4, named=None)),
    ):
        pass
    with (
        pytest.raises(CellError, match=r"--named: expected with a store's file "),
        source(argparse.Namespace(run=str(tmp_path / "run"), seed=None, named="x")),
    ):
        pass
    other = (tmp_path / "run" / "summary.json").read_text().replace(digests["episodes"], "0" * 64)
    (tmp_path / "run" / "summary.json").write_text(other)
    expected = "expected episodes of digest 000000000000 when run again"
    with (
        source(argparse.Namespace(run=str(tmp_path / "run"), seed=None, named=None)) as again,
        pytest.raises(DivergedError, match=expected),
    ):
        list(again.episodes)


def test_of_a_stores_file_the_run_with_the_seed_that_was_asked_for_is_taken(
    tmp_path: Path, definition: Definition, record_run: Callable[..., Any], store_of: Callable[..., Path]
) -> None:
    runs = [record_run(definition, seed, 1) for seed in (3, 33)]
    two = store_of(tmp_path / "two.sqlite", *runs)
    single = store_of(tmp_path / "single.sqlite", runs[0])

    def taken(path: Path, seed: int | None, name: str | None = None) -> tuple[str, int]:
        with source(argparse.Namespace(run=str(path), seed=seed, named=name, cell=None)) as found:
            return found.name, found.seed

    assert [taken(two, 3), taken(two, 33), taken(single, 3), taken(single, None)] == [
        (one.record.run, one.record.seed) for one in (*runs, runs[0], runs[0])
    ]
    for path, seed, said in (
        (single, 9, f"--seed: expected 3, which {runs[0].record.run} has, got 9"),
        (two, 9, f"--seed: expected that of one of {runs[0].record.run}, {runs[1].record.run}, got 9"),
        (two, None, f"--named: expected to be told which one of {runs[0].record.run}, {runs[1].record.run}"),
    ):
        with pytest.raises(CellError, match=re.escape(said)):
            taken(path, seed)
    imported = record_run(definition, 3, 1, runs[1].run.learnt())
    both = store_of(tmp_path / "both.sqlite", runs[0], imported)
    with pytest.raises(CellError, match=r"--named: expected to be told which one of "):
        taken(both, 3)
    for one in (runs[0], imported):
        assert taken(both, None, one.record.run) == (one.record.run, 3)


@pytest.mark.parametrize("there", ["nothing/here", "empty"])
def test_what_is_no_run_is_refused(tmp_path: Path, there: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    with (
        pytest.raises(CellError, match=r"expected (a run|the folder of a run)"),
        source(argparse.Namespace(run=there, seed=None, named=None)),
    ):
        pass


def test_what_is_there_stays_unless_forced_and_failures_leave_nothing(tmp_path: Path) -> None:
    path = tmp_path / "out"
    path.write_text("before")
    with pytest.raises(ExportError, match="expected nothing there yet, got a file; --force"), aside(path, force=False):
        pass
    with pytest.raises(RuntimeError), aside(path, force=True) as place:
        place.write_text("half")
        raise RuntimeError
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]
    with aside(path, force=True) as place:
        place.mkdir()
        (place / "file").write_text("whole")
    with aside(path, force=True) as place:
        place.mkdir()
    assert list(tmp_path.iterdir()) == [path] and list(path.iterdir()) == []


@pytest.mark.parametrize("write", [parquet.write, mcap.write, lerobot.write], ids=["parquet", "mcap", "lerobot"])
def test_a_disk_that_is_full_is_one_line_and_leaves_nothing(tmp_path: Path, recorded: Source, write: Write) -> None:
    """No more than a few bytes of a file can be written, which is told as a full disk is."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        with (
            pytest.raises(ExportError, match="cannot be written, and nothing of it is there: ") as caught,
            aside(tmp_path / "out", force=False) as place,
        ):
            write(place, recorded, rows(recorded))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "\n" not in str(caught.value) and list(tmp_path.iterdir()) == []


def test_the_command_says_what_it_wrote_and_what_it_cannot(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "treenail", "export", "nowhere/run", "--to", "parquet"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("treenail export: nowhere/run: expected the folder of a run")


def packet(sequence: int, count: int = 8) -> FtPacket:
    forces = tuple((float(sequence - count + 1 + place), 0.0, -1.0) for place in range(count))
    return FtPacket(
        sequence=sequence,
        t_ns=sequence * 125_000,
        period_ns=125_000,
        force_n=forces,
        torque_nm=((0.0, 0.1, 0.0),) * count,
    )


def test_the_stream_is_recorded_in_bounded_pieces_and_read_back(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    from experiments.export.stream import TOPIC, Pieces

    pieces = Pieces(tmp_path / "ft", piece_bytes=30_000, most_bytes=10**6)
    for sequence in range(7, 8000, 8):
        if sequence != 4007:
            pieces.take(packet(sequence))
    pieces.close()
    assert (pieces.samples, pieces.lost) == (8000 - 8, 8)
    assert len(pieces.whole()) > 1 and len(list((tmp_path / "ft").iterdir())) == len(pieces.whole())
    read = [message for piece in pieces.whole() for message in reader.read_ros2_messages(str(piece), topics=[TOPIC])]
    assert [message.ros_msg.wrench.force.x for message in read] == [n for n in range(8000) if not 4000 <= n < 4008]
    assert [message.log_time_ns for message in read[:3]] == [0, 125_000, 250_000]


def test_the_oldest_pieces_go_and_another_recorder_goes_on(tmp_path: Path) -> None:
    from experiments.export.stream import Pieces

    for start in (0, 400_000):
        pieces = Pieces(tmp_path, piece_bytes=20_000, most_bytes=60_000)
        for sequence in range(start + 7, start + 4000, 8):
            pieces.take(packet(sequence))
        pieces.close()
    alone = structs.replace(packet(0, 1), period_ns=0)
    for episode in (7, 8):
        pieces.take(structs.replace(alone, sequence=episode << 17))
    pieces.close()
    assert pieces.lost == 0, "the simulator numbers its samples by episode and motion"
    names = [path.name for path in pieces.whole()]
    assert "ft-000000.mcap" not in names and names == sorted(names)
    assert sum(path.stat().st_size for path in pieces.whole()) <= 60_000


def test_a_full_disk_ends_recording_in_one_line_and_leaves_what_is_whole(tmp_path: Path) -> None:
    from experiments.export.stream import Pieces

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    pieces = Pieces(tmp_path, piece_bytes=10**9, most_bytes=10**9)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        with pytest.raises(ExportError, match="cannot record, what is there stays: File too large"):
            for sequence in range(7, 80_000, 8):
                pieces.take(packet(sequence))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []
