"""To Rerun: the server that viewers on any machine attach to, the file, and how each item becomes columns."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import rerun as rr

from services.bus import ports
from services.viewer import colours, layout, record, shapes
from services.viewer.address import bracketed
from services.viewer.decimate import Nanoseconds
from services.viewer.recording import new_piece
from services.wire.definition import Definition
from services.wire.errors import CellError

AXIS_MM = 6.0
"""Length of the tool frame's axes in the scene; in the colours of the force's components."""
AXIS_COLOURS = [colours.SKY_BLUE, colours.ORANGE, colours.GREEN]
_SIZE = re.compile(r"^[1-9][0-9]{0,8}(MB|GB|MiB|GiB)$")


class Stream:
    """One recording, served and, when asked for, saved."""

    def __init__(self, bind: str, port: int, memory_limit: str, save: Path | None) -> None:
        """Serve on ``bind``:``port`` (0 for any free port), keeping the newest ``memory_limit`` (as "16MB") of data.

        ``save`` is recorded to as well, or what ``new_piece`` makes of it.

        Raises CellError when the port is taken, the file cannot be written, or the limit is no size.
        """
        if not _SIZE.match(memory_limit):
            raise CellError(f"viewer: memory limit: expected a size such as 16MB or 1GiB, got {memory_limit!r}")
        self.port = free_port(bind, port)
        self.recording: Path | None = None
        sinks: list[rr.GrpcServerSink | rr.FileSink] = []
        try:
            server = rr.GrpcServerSink(
                bind_ip=bracketed(bind),
                port=self.port,
                server_memory_limit=memory_limit,
                newest_first=True,
            )
            sinks.append(server)
            if save is not None:
                # Without a footer: it would keep something of each chunk in memory until the end of the run.
                self.recording = new_piece(save)
                sinks.append(rr.FileSink(self.recording, write_footer=False))
            self._recording = rr.RecordingStream(layout.APPLICATION)
            self._recording.set_sinks(*sinks, default_blueprint=layout.blueprint())
        except (OSError, RuntimeError, ValueError) as error:
            raise CellError(f"viewer: cannot stream: {error}") from error
        layout.style(self._recording)

    def close(self) -> None:
        """Send what is left and end the stream."""
        self._recording.flush(timeout_sec=5.0)
        self._recording.disconnect()

    def begin(self, name: str, definition: Definition) -> None:
        """Show the parts of an experiment, and call the recording after it."""
        self._recording.send_recording_name(name)
        hole, peg = shapes.hole_mesh(definition.parts), shapes.peg_mesh(definition.parts)
        self._static(record.HOLE, _mesh(hole, colours.GREY))
        self._static(f"{record.PEG}/body", _mesh(peg, (*colours.SKY_BLUE, 170)))
        outline = shapes.peg_outline(definition.parts)
        self._static(f"{record.PEG}/outline", rr.LineStrips3D(outline, colors=colours.YELLOW, radii=0.12))
        axes = rr.Arrows3D(
            vectors=AXIS_MM * np.eye(3), labels=["x", "y", "z"], show_labels=True, colors=AXIS_COLOURS, radii=0.15
        )
        self._static(f"{record.PEG}/axes", axes)
        self._static(f"{record.FLANGE}/outline", rr.LineStrips3D(outline, colors=colours.ORANGE, radii=0.06))

    def send(self, item: record.Item) -> None:
        """Send one item."""
        if isinstance(item, record.Series):
            self._send_series(item)
        elif isinstance(item, record.Placement):
            columns = rr.Transform3D.columns(translation=[item.translation], quaternion=[item.quaternion])
            self._recording.send_columns(item.entity, [_time(np.array([item.time_ns]))], columns)
        elif isinstance(item, record.Push):
            self._send_push(item)
        elif isinstance(item, record.Lines):
            shades = [colours.GREY if level == "INFO" else colours.ORANGE for level in item.levels]
            columns = rr.TextLog.columns(text=item.texts, level=item.levels, color=shades)
            self._recording.send_columns(item.entity, [_time(item.times_ns), _episode(item.episodes)], columns)
        elif isinstance(item, record.About):
            self._at(item.time_ns)
            self._recording.log(record.ABOUT, rr.TextDocument(item.text))
        elif isinstance(item, record.Bars):
            self._send_bars(item)
        else:
            self._send_table(item)

    def _send_push(self, item: record.Push) -> None:
        self._at(item.time_ns)
        if item.arrow_mm is None:
            self._recording.log(record.PUSH, rr.Clear(recursive=False))
            return
        label = rr.Arrows3D(
            vectors=[item.arrow_mm], labels=[item.label], show_labels=True, colors=colours.VERMILION, radii=0.35
        )
        self._recording.log(record.PUSH, label)

    def _send_series(self, item: record.Series) -> None:
        rows, width = item.values.shape
        indexes = [_time(item.times_ns)]
        if item.episodes is not None:
            indexes.append(_episode(item.episodes))
        columns = rr.Scalars.columns(scalars=item.values.reshape(-1)).partition(np.full(rows, width))
        self._recording.send_columns(item.entity, indexes, columns)

    def _send_bars(self, item: record.Bars) -> None:
        middles = item.firsts + (item.width - 1) / 2
        widths = np.full(len(middles), float(item.width))
        chart = rr.BarChart(item.values, abscissa=middles, widths=widths, color=colours.SKY_BLUE)
        self._at(item.time_ns)
        self._recording.log(item.entity, chart)

    def _at(self, time_ns: int) -> None:
        self._recording.set_time(layout.TIME, duration=np.timedelta64(time_ns, "ns"))

    def _send_table(self, item: record.Table) -> None:
        self._at(item.time_ns)
        pixels = colours.stretched(colours.viridis(item.values, item.visited), layout.TABLE_HIGH, layout.TABLE_WIDE)
        self._recording.log(layout.Q_TABLE, rr.Image(pixels))
        self._recording.log("agent/values", rr.Tensor(item.values, dim_names=("action", "state")))
        actions, states = item.values.shape
        row, column = layout.TABLE_HIGH / actions, layout.TABLE_WIDE / states
        tried = ((state, action) for state, action in enumerate(item.best) if item.visited[action, state])
        dots = [((state + 0.5) * column, (action + 0.5) * row) for state, action in tried]
        self._recording.log("agent/best", rr.Points2D(dots, colors=colours.VERMILION, radii=1.3, draw_order=40.0))
        # Rerun draws a label below its point, so that a point stands some way above what it names.
        labels = [((-6.0, (action - 0.4) * row), name) for action, name in enumerate(item.actions)]
        named = range(0, states, 1 if states <= 10 else 5 if states <= 50 else 20)
        labels += [(((state + 0.5) * column, -10.0), str(state)) for state in named]
        labels.append(((layout.TABLE_WIDE / 2, -18.0), "contact state"))
        visited = item.values[item.visited]
        if visited.size:
            scale = f"Q from {visited.min():.1f} (dark) to {visited.max():.1f} (light)"
            labels.append(((layout.TABLE_WIDE / 2, layout.TABLE_HIGH + 0.7), f"{scale}; grey: untried"))
        places, names = [place for place, _ in labels], [name for _, name in labels]
        names_at = rr.Points2D(places, labels=names, show_labels=True, radii=0.0, colors=(220, 220, 220))
        self._recording.log("agent/labels", names_at)

    def _static(self, entity: str, what: rr.AsComponents) -> None:
        self._recording.log(entity, what, static=True)


def free_port(bind: str, port: int) -> int:
    """Return ``port``, or a free one for 0. Raises CellError when it cannot be listened on.

    Rerun itself does not say so: it would serve nobody and drop what it is given.
    """
    try:
        return ports.free_port(bind, port)
    except (OSError, OverflowError) as error:
        raise CellError(f"viewer: expected a free port at {bind}, got {port}: {error}") from error


def _mesh(mesh: shapes.Mesh, colour: tuple[int, ...]) -> rr.Mesh3D:
    return rr.Mesh3D(vertex_positions=mesh.corners, vertex_normals=mesh.normals, albedo_factor=colour)


def _time(times_ns: Nanoseconds) -> rr.TimeColumn:
    return rr.TimeColumn(layout.TIME, duration=times_ns.astype("timedelta64[ns]"))


def _episode(episodes: tuple[int, ...]) -> rr.TimeColumn:
    return rr.TimeColumn(layout.EPISODE, sequence=episodes)
