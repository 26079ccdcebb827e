"""A recording as a Rerun recording: the view of a run, not its archive."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from recordings import plate_mesh, replay_data
from recordings.blueprint import TIMELINE, Layout, dashboard
from recordings.reader import Recording
from recordings.replay_data import Curve, Deflection, Moments, Plot, Span
from recordings.writer import RecordingError

_LEVELS = {1: "DEBUG", 2: "INFO", 3: "WARN", 4: "ERROR", 5: "CRITICAL"}  # of foxglove.Log
_LINE_COLOURS = {
    "xi": (96, 165, 250), "F_c": (248, 113, 113), "F_a": (74, 222, 128),
    "v_p": (192, 132, 252), "measured": (250, 204, 21),
}  # fmt: skip
_CONTACTS_LISTED = 4
_STEEL, _TOUCHING = 0xC4CCD6FF, 0xFFB020FF
_STATE_COLOURS = {
    "apart": 0x3A4150FF, "in contact": 0xFFB020FF, "off": 0x3A4150FF, "idle": 0x3A4150FF,
    "watching": 0x3B82F6FF, "acting": 0x22A05AFF,
}  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """What a replay shows, worked out once; see `prepare`."""

    recording: Recording
    deflection: Deflection
    contacts: list[Span]
    when: Moments
    plots: list[Plot]
    drawn: plate_mesh.Scale
    sphere_radius_m: float


def prepare(recording: Recording, deflection: Deflection) -> Shown:
    """What there is to show. The recording has at least one step, see `check_replayable`."""
    truth = recording.truth
    contacts = replay_data.contact_spans(truth.arrays["xi_m"])
    when = replay_data.moments(truth.time_ns, contacts, truth.step_ns)
    radius = float(replay_data.scene_value(recording, "sphere", "radius_m", 0.0))
    drawn = plate_mesh.scale(deflection, when.selection_ns, radius)
    plots = replay_data.plots(recording)
    return Shown(recording, deflection, contacts, when, plots, drawn, radius)


def check_replayable(recording: Recording) -> None:
    """Raises RecordingError if the recording holds no step."""
    if not recording.truth.samples:
        raise RecordingError(
            f"{recording.path} holds no step of the simulation: there is nothing to replay"
        )


def save(shown: Shown, path: Path, still: bool = False) -> None:
    """Write an .rrd file, with a dashboard for the viewer or for a `still` picture.

    Raises RecordingError if the file cannot be written.
    """
    recording = shown.recording
    # One application per file: the viewer remembers a layout by application, and the times
    # in this one fit this recording only.
    name, run_id = f"hertzloop {recording.path.stem}", recording.metadata.get("run_id")
    stream = rr.RecordingStream(name, recording_id=run_id)
    # By way of memory: a stream that saves to a file on a full disk blocks for ever (0.41).
    memory = stream.memory_recording()
    stream.send_blueprint(dashboard(_layout(shown), still), make_active=False)
    fill(stream, shown, still)
    try:
        path.write_bytes(memory.drain_as_bytes())
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error


def fill(stream: rr.RecordingStream, shown: Shown, still: bool = False) -> None:
    """Send everything a replay shows: /scene, /overview, /zoom, /events, /states, /about."""
    _send_plate(stream, shown)
    _send_sphere(stream, shown)
    for plot in shown.plots:
        for curve in plot.curves:
            _send_curve(stream, shown, plot, curve)
    _send_events(stream, shown.recording)
    _send_states(stream, shown)
    stream.log(
        "about", rr.TextDocument(_about(shown, still), media_type="text/markdown"), static=True
    )


def _layout(shown: Shown) -> Layout:
    return Layout(
        plots=[(plot.key, plot.title) for plot in shown.plots],
        selection_ns=shown.when.selection_ns,
        zoom_ns=shown.when.zoom_ns,
        plate_m=(float(shown.deflection.x_m[-1]), float(shown.deflection.y_m[-1])),
        surface_title=f"Plate, heights drawn {shown.drawn.heights:,.0f} times",
    )


def _times(time_ns: np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def _send_plate(stream: rr.RecordingStream, shown: Shown) -> None:
    deflection, drawn = shown.deflection, shown.drawn
    frames, nodes = len(deflection.times_ns), deflection.w_m[0].size
    x, y = deflection.x_m[-1], deflection.y_m[-1]
    edge = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0), (0, 0, 0)]
    stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("scene/edge", rr.LineStrips3D([edge], colors=(120, 130, 145)), static=True)
    indices = rr.Mesh3D.from_fields(triangle_indices=plate_mesh.triangles(deflection))
    stream.log("scene/plate", indices, static=True)
    columns = rr.Mesh3D.columns(
        vertex_positions=plate_mesh.vertices(deflection, drawn).reshape(-1, 3),
        vertex_normals=plate_mesh.normals(deflection, drawn).reshape(-1, 3),
        vertex_colors=plate_mesh.colours(deflection, drawn).ravel(),
    )
    stream.send_columns(
        "scene/plate", [_times(deflection.times_ns)], columns.partition([nodes] * frames)
    )


def _send_sphere(stream: rr.RecordingStream, shown: Shown) -> None:
    truth, deflection = shown.recording.truth, shown.deflection
    steps = np.searchsorted(truth.time_ns, deflection.times_ns)
    centres = plate_mesh.sphere_centres(deflection, truth.arrays["xi_s_m"][steps], shown.drawn)
    colours = np.where(truth.arrays["xi_m"][steps] < 0.0, _TOUCHING, _STEEL).astype(np.uint32)
    shape = rr.Ellipsoids3D.from_fields(
        half_sizes=[(shown.drawn.sphere_radius_m,) * 3], fill_mode="solid"
    )
    stream.log("scene/sphere", shape, static=True)
    columns = rr.Ellipsoids3D.columns(centers=centres, colors=colours)
    stream.send_columns("scene/sphere", [_times(deflection.times_ns)], columns)


def _send_curve(stream: rr.RecordingStream, shown: Shown, plot: Plot, curve: Curve) -> None:
    step_ns = shown.recording.truth.time_ns
    # A contact in steps, as positions of this curve's samples: a converter may be slower.
    own = [
        (int(np.searchsorted(curve.time_ns, step_ns[a])),
         int(np.searchsorted(curve.time_ns, step_ns[b - 1], side="right")))
        for a, b in shown.contacts
    ]  # fmt: skip
    spans = replay_data.full_rate_spans(own, len(curve.values))
    for entity, held, chosen in (
        ("overview", False, replay_data.extremes(curve.values, replay_data.OVERVIEW_POINTS)),
        ("zoom", curve.held, replay_data.zoom_positions(curve.values, spans)),
    ):
        path = f"{entity}/{plot.key}/{curve.name}"
        line = rr.SeriesLines(
            names=curve.name,
            colors=_LINE_COLOURS[curve.name],
            widths=1.5,
            aggregation_policy="MinMax",
            interpolation_mode="StepAfter" if held else "Linear",
        )
        stream.log(path, line, static=True)
        columns = rr.Scalars.columns(scalars=curve.values[chosen])
        stream.send_columns(path, [_times(curve.time_ns[chosen])], columns)


def _send_events(stream: rr.RecordingStream, recording: Recording) -> None:
    if not recording.events:
        return
    columns = rr.TextLog.columns(
        text=[f"{e.time_ns * 1e-6:.3f} ms  {e.message}" for e in recording.events],
        level=[_LEVELS.get(event.level, "INFO") for event in recording.events],
    )
    times = _times(np.array([event.time_ns for event in recording.events]))
    stream.send_columns("events", [times], columns)


def _send_states(stream: rr.RecordingStream, shown: Shown) -> None:
    recording, time_ns = shown.recording, shown.recording.truth.time_ns
    contact = [(int(time_ns[0]), "apart")]
    for start, end in shown.contacts:
        contact.append((int(time_ns[start]), "in contact"))
        if end < len(time_ns):
            contact.append((int(time_ns[end]), "apart"))
    for name, states in (("contact", contact), ("law", replay_data.law_states(recording))):
        known = list(dict.fromkeys(state for _, state in states))
        colours = [_STATE_COLOURS.get(state, 0x808080FF) for state in known]
        looks = rr.StateConfiguration(
            values=known, labels=known, colors=np.array(colours, np.uint32)
        )
        stream.log(f"states/{name}", looks, static=True)
        columns = rr.StateChange.columns(state=[state for _, state in states])
        times = _times(np.array([time for time, _ in states]))
        stream.send_columns(f"states/{name}", [times], columns)


def _about(shown: Shown, still: bool) -> str:
    """Scene, contacts, how it is drawn, and what is missing, as markdown."""
    recording, truth, contacts = shown.recording, shown.recording.truth, shown.contacts
    xi, f_c = truth.arrays["xi_m"], truth.arrays["f_c_n"]
    name = recording.metadata.get("scene", recording.path.stem)
    lines = [f"## {name}", "", replay_data.scene_shows(recording), ""]
    rows = [
        f"| {truth.time_ns[a] * 1e-6:.3f} | {(b - a) * truth.step_ns * 1e-3:g} | "
        f"{_short(f_c[a:b].max())} | {_short(-xi[a:b].min() * 1e6)} |"
        for a, b in contacts[:_CONTACTS_LISTED]
    ]
    if rows:
        lines += ["| contact at (ms) | for (µs) | F_c (N) | depth (µm) |", "|--|--|--|--|", *rows]
    if len(contacts) > len(rows):
        lines += ["", f"{len(contacts)} contacts in all."]
    if not contacts:
        lines += ["No contact in this recording."]
    lines += ["", f"Heights are drawn {shown.drawn.heights:,.0f} times"]
    if shown.sphere_radius_m:
        larger = shown.drawn.sphere_radius_m / shown.sphere_radius_m
        lines[-1] += f", the sphere {larger:.2g} times its size"
    lines[-1] += ". Its penetration is plotted, not drawn."
    if contacts and not still:
        lines += ["", f"Play the first contact from {shown.when.selection_ns[0] * 1e-6:.3f} ms on."]
    for problem in recording.problems:
        lines += ["", f"**Missing or damaged:** {problem}"]
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    """Three digits, large numbers whole."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
