"""What is where on the screen, and how each curve looks."""

from __future__ import annotations

from typing import Literal

import rerun as rr
import rerun.blueprint as rrb

from services.viewer import colours, record
from services.viewer.recent import WINDOW

APPLICATION = "treenail"
TIME = "time"
"""Timeline: time since the viewer's start."""
EPISODE = "episode"
"""Timeline: number of the episode, for what there is one of in an episode."""
SHOWN_S = 15.0
"""How far back the curves of forces and decisions reach."""

EYE_MM = (31.0, -47.0, -36.0)
"""Where the scene is looked at from, hole frame: from the side that is cut open, and above."""

Q_TABLE = "agent/q_table"
TABLE_HIGH, TABLE_WIDE = 66, 120
"""Size of the table on its canvas, however many states there are: a view does not follow what grows.

Small: each browser keeps every picture of it unpacked.
"""

STYLES: dict[str, tuple[tuple[str, colours.Colour], ...]] = {
    record.FORCE: (("fx [N]", colours.SKY_BLUE), ("fy [N]", colours.ORANGE), ("fz [N]", colours.GREEN)),
    record.TORQUE: (("tx [N·m]", colours.SKY_BLUE), ("ty [N·m]", colours.ORANGE), ("tz [N·m]", colours.GREEN)),
    record.MAGNITUDE: (("|F| [N]", colours.YELLOW), ("collision limit [N]", colours.VERMILION)),
    record.REWARD: (("reward", colours.PURPLE),),
    record.RETURN: (("return", colours.GREY), (f"mean of {WINDOW}", colours.YELLOW)),
    record.FAILURES: ((f"failures in the last {WINDOW}", colours.VERMILION),),
}
"""Name and colour of each column that is drawn as a line."""

MARKS: dict[str, tuple[str, colours.Colour]] = {
    record.STATE: ("contact state", colours.SKY_BLUE),
    record.ACTION: ("action", colours.ORANGE),
}
"""Name and colour of what is drawn as separate marks: numbers that are names."""


def blueprint() -> rrb.Blueprint:
    """Return the whole layout: peg and what it feels above, what was learnt from it below."""
    scene = rrb.Spatial3DView(
        origin="scene",
        name="Peg and hole [mm]",
        background=rrb.Background(color=(24, 26, 30)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=EYE_MM, look_target=(0.0, 0.0, 2.0), eye_up=(0.0, 0.0, -1.0)),
    )
    about = rrb.TextDocumentView(origin=record.ABOUT, name="Experiment")
    felt = rrb.Vertical(
        _recent(record.FORCE, "Force on the peg [N], tool frame"),
        _recent(record.MAGNITUDE, "|F| [N]"),
        _recent(record.TORQUE, "Torque on the peg [N·m], tool frame"),
        rrb.Tabs(
            _recent(record.STATE, "Contact state [number]"),
            _recent(record.ACTION, "Action [number]"),
            _recent(record.REWARD, "Reward"),
        ),
        row_shares=[3, 2, 3, 3],
    )
    table = rrb.Spatial2DView(
        origin="agent",
        name="Action values (dot: best)",
        visual_bounds=rrb.VisualBounds2D(x_range=(-15, TABLE_WIDE + 5), y_range=(-20, TABLE_HIGH + 12)),
        background=rrb.Background(color=(24, 26, 30)),
    )
    log = rrb.TextLogView(
        origin=record.LOG,
        name="Return, mean and peak force",
        columns=rrb.TextLogColumns(timeline_columns=[EPISODE], text_log_columns=["Body"]),
        format_options=rrb.TextLogFormat(monospace_body=True),
    )
    learnt = rrb.Vertical(
        _whole(record.RETURN, "Return of each episode", "RightBottom"),
        _whole(record.FAILURES, f"Failures per {WINDOW} episodes", "RightTop", (-0.5, WINDOW + 0.5)),
        rrb.BarChartView(
            origin=record.RUN,
            name="Return by episode, whole run",
            plot_legend=rrb.PlotLegend(visible=False),
        ),
        log,
        row_shares=[3, 2, 3, 4],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(about, scene, table, row_shares=[5, 18, 13]),
            felt,
            learnt,
            column_shares=[6, 8, 7],
        ),
        rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _recent(entity: str, name: str) -> rrb.TimeSeriesView:
    """Return a plot of the last seconds."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-SHOWN_S)
    return rrb.TimeSeriesView(
        origin=entity,
        name=name,
        time_ranges=rrb.VisibleTimeRange(TIME, start=start, end=rrb.TimeRangeBoundary.cursor_relative()),
        plot_legend=rrb.PlotLegend(corner="LeftTop"),
    )


def _whole(
    entity: str, name: str, corner: Literal["RightBottom", "RightTop"], span: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    """Return a plot of all that was seen of the run; a run that goes well leaves ``corner`` to the legend."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    return rrb.TimeSeriesView(
        origin=entity,
        name=name,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        time_ranges=rrb.VisibleTimeRange(TIME, start=start, end=end),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner=corner),
    )


def style(recording: rr.RecordingStream) -> None:
    """Log how curves and marks look."""
    for entity, columns in STYLES.items():
        names, shades = [name for name, _ in columns], [colour for _, colour in columns]
        recording.log(entity, rr.SeriesLines(names=names, colors=shades, widths=[1.25] * len(columns)), static=True)
    for entity, (name, colour) in MARKS.items():
        marks = rr.SeriesPoints(names=name, colors=colour, markers="Circle", marker_sizes=2.5)
        recording.log(entity, marks, static=True)
    recording.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_DOWN, static=True)
