"""A recording as a Rerun recording: the view of a run, not its archive."""

import math
from pathlib import Path

import numpy as np
import rerun as rr

from hertzloop.common.atomic_files import atomic_write
from hertzloop.recordings.recording import Event, Recording
from hertzloop.recordings.replay import axis_range, blueprint, scene3d
from hertzloop.recordings.replay import spectrum as spectra_drawn
from hertzloop.recordings.replay.decimation import enough
from hertzloop.recordings.replay.law_states import law_states
from hertzloop.recordings.replay.plots import Plot, PlotCurve
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.recordings.replay.scene3d import times, with_unit

_LEVELS = {1: "DEBUG", 2: "INFO", 3: "WARN", 4: "ERROR", 5: "CRITICAL"}  # of foxglove.Log
_LINE_COLOURS = {
    "xi": (96, 165, 250),
    "F_c": (248, 113, 113),
    "F_a": (74, 222, 128),
    "v_p": (192, 132, 252),
    "measured": (250, 204, 21),
    "sphere": (96, 165, 250),
    "plate": (192, 132, 252),
    "contact": (248, 113, 113),
    "fed": (74, 222, 128),
    "held": (251, 146, 60),
    "latency": (250, 204, 21),
}
_FAINT = (150, 156, 166), (201, 167, 110)  # of what is there to compare with
_EXACT_SHARE = 5e-4  # error of a curve at the cursor, of its axis: below one pixel
_MOST_LISTED = 2000  # contacts
_LINE = 66  # characters of an event that the dashboard shows
_STATE_COLOURS = {
    "apart": 0x3A4150FF,
    "in contact": 0xFFB020FF,
    "off": 0x3A4150FF,
    "idle": 0x3A4150FF,
    "watching": 0x3B82F6FF,
    "acting": 0x22A05AFF,
}


def save(replay: ReplayData, path: Path, still: bool = False) -> None:
    """Write an .rrd file, with a dashboard for the viewer or for a `still` picture.

    Raises NotWritten.
    """
    recording = replay.recording
    # One application per file: the viewer remembers a layout by application, and the times
    # in this one fit this recording only.
    name, run_id = f"hertzloop {recording.path.stem}", recording.metadata.get("run_id")
    stream = rr.RecordingStream(name, recording_id=run_id)
    # By way of memory: a stream that saves to a file on a full disk blocks for ever (0.41).
    memory = stream.memory_recording()
    stream.send_blueprint(
        blueprint.dashboard(
            replay.plots,
            replay.when,
            replay.deflection,
            _surface_title(replay),
            has_contacts=bool(replay.contacts),
            has_spectrum=bool(replay.labels.spectra),
            still=still,
        )
    )
    fill(stream, replay, still)
    atomic_write(path, memory.drain_as_bytes())


def fill(stream: rr.RecordingStream, replay: ReplayData, still: bool = False) -> None:
    """Send everything a replay shows: /scene, /overview, /zoom, /spectrum, /contacts, /events,
    /states, /about."""
    deflection, drawn, at_frames = replay.deflection, replay.drawn, replay.at_frames
    scene3d.send_plate(stream, deflection, drawn)
    scene3d.send_sphere(stream, at_frames["xi_s_m"], at_frames["xi_m"], deflection, drawn)
    if replay.labels.actuator_m is not None:
        at, full_n = replay.labels.actuator_m, _full_arrow_n(replay)
        scene3d.send_actuator(stream, at_frames["f_a_n"], deflection, at, drawn, full_n)
    for plot in replay.plots:
        low, high = axis_range.zoomed(plot, replay.when.around_ns)
        for curve in (one for one in plot.curves if len(one.values)):
            _send_curve(stream, plot, curve, _EXACT_SHARE * (high - low))
    if replay.labels.spectra:
        colours = [_LINE_COLOURS["v_p"], *_FAINT]
        spectra_drawn.send(stream, replay.labels.spectra, colours[: len(replay.labels.spectra)])
    _send_events(stream, replay.recording)
    _send_contacts(stream, replay)
    _send_states(stream, replay)
    stream.log(
        "about", rr.TextDocument(_about(replay, still), media_type="text/markdown"), static=True
    )


def _full_arrow_n(replay: ReplayData) -> float:
    """Actuator force that is drawn with a whole arrow: a round number above the largest around the
    first contact."""
    truth = replay.recording.truth
    force_n = np.abs(truth.arrays["f_a_n"])
    a, b = (ns // truth.step_ns for ns in replay.when.selection_ns)
    largest = float(np.nan_to_num(force_n[a : b + 1]).max(initial=0.0)) or float(force_n.max())
    return scene3d.round_above(largest) if 0.0 < largest < math.inf else 0.0


def _surface_title(replay: ReplayData) -> str:
    if not replay.deflection.known:
        return "Structure, drawn flat: its shapes are unknown"
    if replay.drawn.flat:
        return "Plate at rest"
    full = scene3d.with_unit(replay.drawn.full_colour_m, "m")
    return f"Plate, heights drawn {replay.drawn.in_words}; blue: -{full} and below, red: +{full}"


def _send_curve(stream: rr.RecordingStream, plot: Plot, curve: PlotCurve, within: float) -> None:
    """As an overview and, exact `within` so much, for the plot at the cursor."""
    whole = slice(None) if curve.overview is None else curve.overview
    at_cursor = enough(curve.time_ns, curve.values, within, curve.held)
    faint = [other.name for other in plot.curves if other.faint]
    at = faint.index(curve.name) if curve.faint else -1
    for entity, held, chosen in (("overview", False, whole), ("zoom", curve.held, at_cursor)):
        # Later names are drawn over earlier ones: what is there to compare with lies behind.
        path = f"{entity}/{plot.key}/{'0_' if curve.faint else ''}{curve.name}"
        line = rr.SeriesLines(
            names=curve.label or curve.name,
            colors=_FAINT[at % len(_FAINT)] if curve.faint else _LINE_COLOURS[curve.name],
            widths=1.5,
            aggregation_policy="MinMax",
            interpolation_mode="StepAfter" if held else "Linear",
        )
        stream.log(path, line, static=True)
        columns = rr.Scalars.columns(scalars=curve.values[chosen])
        stream.send_columns(path, [times(curve.time_ns[chosen])], columns)


def _send_events(stream: rr.RecordingStream, recording: Recording) -> None:
    if not recording.events:
        return
    columns = rr.TextLog.columns(
        text=[_event_line(event) for event in recording.events],
        level=[_LEVELS.get(event.level, "INFO") for event in recording.events],
    )
    at = times(np.array([event.time_ns for event in recording.events]))
    stream.send_columns("events", [at], columns)


def _send_states(stream: rr.RecordingStream, replay: ReplayData) -> None:
    recording, truth = replay.recording, replay.recording.truth
    contact = [(0, "apart")]
    for touched in replay.contacts:
        contact.append((touched.first * truth.step_ns, "in contact"))
        if touched.end < truth.samples:
            contact.append((touched.end * truth.step_ns, "apart"))
    law = law_states(recording, replay.labels.controlled)
    for name, states in (("contact", contact), ("law", law)):
        known = list(dict.fromkeys(state for _, state in states))
        colours = [_STATE_COLOURS.get(state, 0x808080FF) for state in known]
        looks = rr.StateConfiguration(
            values=known, labels=known, colors=np.array(colours, np.uint32)
        )
        stream.log(f"states/{name}", looks, static=True)
        columns = rr.StateChange.columns(state=[state for _, state in states])
        at = times(np.array([time for time, _ in states]))
        stream.send_columns(f"states/{name}", [at], columns)


def _send_contacts(stream: rr.RecordingStream, replay: ReplayData) -> None:
    """The menu of contacts: a click on a time moves the cursor there."""
    truth, contacts = replay.recording.truth, replay.contacts[:_MOST_LISTED]
    if not contacts:
        return
    begins_ns = np.array([one.first for one in contacts]) * truth.step_ns
    texts = [
        f"{i} at {begins_ns[i - 1] * 1e-6:z.3f} ms: "
        f"{with_unit((one.end - one.first) * truth.step_ns * 1e-9, 's')}, "
        f"{format(one.peak_n, ',.0f' if one.peak_n >= 100 else '.3g')} N, "
        f"{with_unit(one.deepest_m, 'm')} deep"
        + ("" if one.end < truth.samples else ", cut by the end")
        for i, one in enumerate(contacts, 1)
    ]
    columns = rr.TextLog.columns(text=texts)
    at = times(begins_ns)
    stream.send_columns("contacts", [at], columns)


def _about(replay: ReplayData, still: bool) -> str:
    """What ran, how it is drawn, and what is missing, as markdown."""
    recording, labels = replay.recording, replay.labels
    name = recording.metadata.get("scene", recording.path.stem)
    lines = [f"## {labels.heading or name}", ""]
    for line in labels.lines:
        lines += [line, ""]
    if not replay.contacts:
        lines += ["No contact in this recording.", ""]
    elif len(replay.contacts) > _MOST_LISTED:
        lines += [f"{len(replay.contacts)} contacts; the first {_MOST_LISTED} are listed.", ""]
    if len(replay.contacts) > 1:  # they may be chaotic; what is known of them no recording has
        lines += ["Numbers of single contacts have the digits that were recorded.", ""]
    if not replay.deflection.known:
        lines += ["The mode file has no shapes (x_m, y_m, shape_grid).", ""]
    lines += [f"Heights are drawn {replay.drawn.in_words}"]
    if replay.drawn.flat:
        lines[-1] = "The plate is at rest" if replay.deflection.known else "It is drawn flat"
    if replay.sphere_radius_m:
        larger = replay.drawn.sphere_radius_m / replay.sphere_radius_m
        lines[-1] += f", the sphere {larger:.2g} times its size, at a compressed height in flight"
    lines[-1] += ". Its penetration is plotted, not drawn."
    if replay.contacts and not still:
        lines += [
            "",
            f"Play the first contact from {replay.when.selection_ns[0] * 1e-6:z.3f} ms on.",
        ]
    for problem in recording.problems:
        lines += ["", f"**Missing or damaged:** {problem}"]
    return "\n".join(lines) + "\n"


def _event_line(event: Event) -> str:
    """When and what; of a line that would be cut in its middle the beginning."""
    line = f"{event.time_ns * 1e-6:z.3f} ms  {event.message.removeprefix('law ')}"
    return line if len(line) <= _LINE else line.split(", ", maxsplit=1)[0]
