"""A recording as a Rerun recording: the view of a run, not its archive."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from recordings import plate_mesh, replay_data
from recordings.blueprint import TIMELINE, Layout, dashboard
from recordings.reader import Recording
from recordings.replay_data import Curve, Deflection, Plot, Span
from recordings.writer import RecordingError

_LEVELS = {1: "DEBUG", 2: "INFO", 3: "WARN", 4: "ERROR", 5: "CRITICAL"}  # of foxglove.Log
_LINE_COLOURS = {
    "xi": (96, 165, 250), "F_c": (248, 113, 113), "F_a": (74, 222, 128),
    "v_p": (192, 132, 252), "measured": (250, 204, 21),
}  # fmt: skip
_STEEL, _TOUCHING = 0xC4CCD6FF, 0xFFB020FF
_STATE_COLOURS = {
    "apart": 0x3A4150FF, "in contact": 0xFFB020FF, "off": 0x3A4150FF, "idle": 0x3A4150FF,
    "watching": 0x3B82F6FF, "acting": 0x22A05AFF,
}  # fmt: skip


@dataclass(frozen=True)
class Moments:
    """When something is worth looking at, ns: what play shows, what zoom plots reach, and
    the time of a still picture."""

    selection_ns: Span
    zoom_ns: Span
    still_ns: int


def moments(recording: Recording) -> Moments:
    """Moments of a recording: around its first contact, else spread over the whole."""
    truth = recording.truth
    time_ns, contacts = truth.time_ns, replay_data.contact_spans(truth.arrays["xi_m"])
    first, last = int(time_ns[0]), int(time_ns[-1])
    if not contacts:
        length = max(last - first, truth.step_ns)
        return Moments((first, max(last, first + 1)), (length // 2, length // 2), last)
    start, end = contacts[0]
    begun = int(time_ns[start])
    length = max(end - start, 4) * truth.step_ns
    selection = (max(first, begun - length), min(last, begun + 9 * length))
    still = min(last, begun + length * 2)
    return Moments(selection, (length * 5 // 2, length * 3 // 2), still)


def save(recording: Recording, deflection: Deflection, path: Path, still: bool = False) -> None:
    """Write the replay to an .rrd file, with its dashboard (for a `still` picture if so).

    Raises RecordingError if there is nothing to show or the file cannot be written.
    """
    check_replayable(recording)
    stream = rr.RecordingStream(
        # One application per file: the viewer remembers a layout by application, and this
        # one's times fit this recording only.
        f"hertzloop {recording.path.stem}",
        recording_id=recording.metadata.get("run_id"),
    )
    try:
        stream.save(path, default_blueprint=dashboard(_layout(recording, deflection), still))
    except (OSError, RuntimeError) as error:
        raise RecordingError(f"cannot write {path}: {error}") from error
    fill(stream, recording, deflection)
    stream.flush()
    stream.disconnect()


def check_replayable(recording: Recording) -> None:
    """Raises RecordingError if the recording holds no step."""
    if not recording.truth.samples:
        raise RecordingError(
            f"{recording.path} holds no step of the simulation: there is nothing to replay"
        )


def _layout(recording: Recording, deflection: Deflection) -> Layout:
    when = moments(recording)
    return Layout(
        plots=[(plot.key, plot.title) for plot in replay_data.plots(recording)],
        selection_ns=when.selection_ns,
        zoom_ns=when.zoom_ns,
        plate_m=(float(deflection.x_m[-1]), float(deflection.y_m[-1])),
        surface_title=f"Plate, heights drawn {plate_mesh.exaggeration(deflection):,.0f} times",
    )


def fill(stream: rr.RecordingStream, recording: Recording, deflection: Deflection) -> None:
    """Send everything a replay shows: /scene, /overview, /zoom, /events, /states, /about."""
    _send_plate(stream, deflection)
    _send_sphere(stream, recording, deflection)
    contacts = replay_data.contact_spans(recording.truth.arrays["xi_m"])
    for plot in replay_data.plots(recording):
        for curve in plot.curves:
            _send_curve(stream, plot, curve, recording.truth.time_ns, contacts)
    _send_events(stream, recording)
    _send_states(stream, recording, contacts)
    text = rr.TextDocument(_about(recording, deflection, contacts), media_type="text/markdown")
    stream.log("about", text, static=True)


def _times(time_ns: np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def _send_plate(stream: rr.RecordingStream, deflection: Deflection) -> None:
    factor = plate_mesh.exaggeration(deflection)
    frames, nodes = len(deflection.times_ns), deflection.w_m[0].size
    x, y = deflection.x_m[-1], deflection.y_m[-1]
    edge = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0), (0, 0, 0)]
    stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("scene/edge", rr.LineStrips3D([edge], colors=(120, 130, 145)), static=True)
    indices = rr.Mesh3D.from_fields(triangle_indices=plate_mesh.triangles(deflection))
    stream.log("scene/plate", indices, static=True)
    columns = rr.Mesh3D.columns(
        vertex_positions=plate_mesh.vertices(deflection, factor).reshape(-1, 3),
        vertex_normals=plate_mesh.normals(deflection, factor).reshape(-1, 3),
        vertex_colors=plate_mesh.colours(deflection).ravel(),
    )
    stream.send_columns(
        "scene/plate", [_times(deflection.times_ns)], columns.partition([nodes] * frames)
    )


def _send_sphere(stream: rr.RecordingStream, recording: Recording, deflection: Deflection) -> None:
    truth = recording.truth
    steps = np.searchsorted(truth.time_ns, deflection.times_ns)
    radius = plate_mesh.sphere_radius_drawn_m(deflection, _sphere_radius_m(recording))
    centres = plate_mesh.sphere_centres(
        deflection, truth.arrays["xi_s_m"][steps], plate_mesh.exaggeration(deflection), radius
    )
    colours = np.where(truth.arrays["xi_m"][steps] < 0.0, _TOUCHING, _STEEL).astype(np.uint32)
    shape = rr.Ellipsoids3D.from_fields(half_sizes=[(radius,) * 3], fill_mode="solid")
    stream.log("scene/sphere", shape, static=True)
    columns = rr.Ellipsoids3D.columns(centers=centres, colors=colours)
    stream.send_columns("scene/sphere", [_times(deflection.times_ns)], columns)


def _sphere_radius_m(recording: Recording) -> float:
    return float(replay_data.scene_value(recording, "sphere", "radius_m", 0.0))


def _send_curve(
    stream: rr.RecordingStream, plot: Plot, curve: Curve, step_ns: np.ndarray, contacts: list[Span]
) -> None:
    # A contact in steps, as positions of this curve's samples: a converter may be slower.
    own = [
        (int(np.searchsorted(curve.time_ns, step_ns[a])),
         int(np.searchsorted(curve.time_ns, step_ns[b - 1], side="right")))
        for a, b in contacts
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


def _send_states(stream: rr.RecordingStream, recording: Recording, contacts: list[Span]) -> None:
    time_ns = recording.truth.time_ns
    contact = [(int(time_ns[0]), "apart")]
    for start, end in contacts:
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


def _about(recording: Recording, deflection: Deflection, contacts: list[Span]) -> str:
    """Scene, contacts, how it is drawn, and what is missing, as markdown."""
    truth = recording.truth
    xi, f_c = truth.arrays["xi_m"], truth.arrays["f_c_n"]
    name = recording.metadata.get("scene", recording.path.stem)
    lines = [f"## {name}", "", replay_data.scene_shows(recording), ""]
    rows = [
        f"| {truth.time_ns[a] * 1e-6:.3f} | {(b - a) * truth.step_ns * 1e-3:g} | "
        f"{f_c[a:b].max():.3g} | {-xi[a:b].min() * 1e6:.3g} |"
        for a, b in contacts[:4]
    ]
    if rows:
        lines += ["| contact at (ms) | for (µs) | F_c (N) | depth (µm) |", "|--|--|--|--|", *rows]
        lines += ["", f"{len(contacts)} contacts in all."] if len(contacts) > 4 else []
    else:
        lines += ["No contact in this recording."]
    radius = _sphere_radius_m(recording)
    larger = plate_mesh.sphere_radius_drawn_m(deflection, radius) / radius if radius else 1.0
    lines += [
        "",
        f"Heights are drawn {plate_mesh.exaggeration(deflection):,.0f} times, the sphere "
        f"{larger:.2g} times its size. Its penetration is plotted, not drawn.",
    ]
    for problem in recording.problems:
        lines += ["", f"**Missing or damaged:** {problem}"]
    return "\n".join(lines) + "\n"
