"""The dashboard of a replay: which view shows what, and how time runs."""

from collections.abc import Sequence

import rerun.blueprint as rrb
from rerun.blueprint.components import AbsoluteTimeRange

from hertzloop.recordings.replay.axis_range import whole, zoomed
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.moments import Moments
from hertzloop.recordings.replay.plots import Plot

TIMELINE = "sim_time"
_FIRST_IMPACT_LASTS_S = 8.0  # on the wall, when somebody presses play
_BACKGROUND = (16, 18, 24)
_ZOOM_TO_OVERVIEW = [1.25, 1.0]


def dashboard(
    plots: Sequence[Plot],
    when: Moments,
    plate: Deflection,
    title: str,
    *,
    has_contacts: bool,
    has_spectrum: bool,
    still: bool = False,
) -> rrb.Blueprint:
    """The one blueprint of a replay, with the `title` of the plate. Pressing play shows
    `when.selection_ns`; zoom plots follow the cursor. A `still` picture goes without the menu."""
    first, last = when.selection_ns
    lists = [_contacts()] if has_contacts else []
    left: list[rrb.Container | rrb.View] = [
        _surface(plate, title),
        rrb.Horizontal(
            rrb.TextDocumentView(origin="about", name="Run"),
            rrb.Vertical(*lists, _events()),
            column_shares=[1.0, 1.2],
        ),
    ]
    if has_spectrum:
        left.append(_spectrum())
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[1.1, 1.4, 0.8][: len(left)]),
            rrb.Vertical(
                *(_plot_row(plot, when) for plot in plots),
                _state_row(when),
                row_shares=[*(1.0 for _ in plots), 0.17 * len(plots)],
            ),
            column_shares=[1.0, 1.2],
        ),
        rrb.TopPanel(state="hidden" if still else "expanded"),
        rrb.BlueprintPanel(state="hidden" if still else "collapsed"),
        rrb.SelectionPanel(state="hidden" if still else "collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=TIMELINE,
            playback_speed=(last - first) * 1e-9 / _FIRST_IMPACT_LASTS_S,
            play_state="paused",
            loop_mode="selection",
            time_selection=AbsoluteTimeRange(first, last),
        ),
        auto_layout=False,
        auto_views=False,
    )


def _surface(plate: Deflection, title: str) -> rrb.Spatial3DView:
    (x0, y0), (x, y) = plate.low_m, plate.size_m
    side = max(x, y)
    middle = x0 + 0.55 * x, y0 + 0.5 * y
    return rrb.Spatial3DView(
        origin="scene",
        name=title,
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(middle[0] + 0.3 * side, middle[1] - 1.05 * side, 0.62 * side),
            look_target=(*middle, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _boundaries(when: Moments) -> tuple[rrb.TimeRangeBoundary, rrb.TimeRangeBoundary]:
    before, after = when.zoom_ns
    cursor_relative = rrb.TimeRangeBoundary.cursor_relative
    return cursor_relative(nanos=-before), cursor_relative(nanos=after)


def _around_cursor(when: Moments) -> rrb.TimeAxis:
    start, end = _boundaries(when)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def _events() -> rrb.TextLogView:
    # The text says when, in full; a column would cut it short.
    no_time = rrb.encodings.TimelineColumn(TIMELINE, visible=False)
    shown = rrb.TextLogColumns(timeline_columns=[no_time], text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(origin="events", name="Events", columns=shown)


def _contacts() -> rrb.TextLogView:
    """The times are what to click on."""
    shown = rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["body"])
    return rrb.TextLogView(
        origin="contacts", name="Contacts: click on a time to move the cursor", columns=shown
    )


def _spectrum() -> rrb.BarChartView:
    return rrb.BarChartView(
        origin="spectrum",
        name="Plate velocity v_p, first half second: dB re 1 um/s in 1/12 octaves over lg(f / Hz)",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _plot_row(plot: Plot, when: Moments) -> rrb.Horizontal:
    """A zoom that follows the cursor beside an overview of the whole run."""
    start, end = _boundaries(when)
    zoom = rrb.TimeSeriesView(
        origin=f"zoom/{plot.key}",
        name=f"{plot.title}, at the cursor",
        axis_x=_around_cursor(when),
        axis_y=rrb.ScalarAxis(range=zoomed(plot, when.around_ns)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
        # Only what is visible is queried: full rate costs nothing this way.
        time_ranges=[rrb.VisibleTimeRange(TIMELINE, start=start, end=end)],
    )
    overview = rrb.TimeSeriesView(
        origin=f"overview/{plot.key}",
        name="Whole run",
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=rrb.ScalarAxis(range=whole(plot)),
        plot_legend=rrb.PlotLegend(visible=False),  # as beside it
    )
    return rrb.Horizontal(zoom, overview, column_shares=_ZOOM_TO_OVERVIEW)


def _state_row(when: Moments) -> rrb.Horizontal:
    zoom = rrb.StateTimelineView(
        origin="states", name="States, at the cursor", time_view=_around_cursor(when)
    )
    overview = rrb.StateTimelineView(
        origin="states", name="States, whole run", time_view=rrb.TimeAxis(link="LinkToGlobal")
    )
    return rrb.Horizontal(zoom, overview, column_shares=_ZOOM_TO_OVERVIEW)
