"""Replay of a recording: a file for the Rerun viewer, a picture, or a window."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

from hertzloop.analysis.curves import Overlay, overlay
from hertzloop.analysis.deflection import deflection
from hertzloop.analysis.meters import StabilityMeter
from hertzloop.analysis.recorded import pacing_of, pieces_of
from hertzloop.bus.streams import LAST_NS
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay import as_rerun as rerun_replay
from hertzloop.recordings.replay import data as replay_data
from hertzloop.recordings.replay import viewer
from hertzloop.recordings.replay.as_rerun import Told
from hertzloop.recordings.replay.spectrum import spectrum
from hertzloop.recordings.replay.viewer import screenshot
from hertzloop.recordings.writer import RecordingError
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup, parse
from hertzloop.setup.build import free_series
from hertzloop.views import provenance
from hertzloop.views.run import pacing_sentences

has_display = viewer.has_display
_OF_TWIN = ("xi", "F_c", "F_a", "v_p", "plate")
_ENERGIES = {
    "sphere": "sphere", "plate": "plate", "contact": "contact", "fed": "fed in by actuator",
}  # fmt: skip
_PREFIXES = ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ"), (1e-9, "nJ"))


def replay(
    recording: Recording,
    save: Path | None,
    picture: Path | None,
    other: Recording | None = None,
    alone: bool = False,
) -> None:
    """Write `save` (.rrd) and `picture` (.png); with neither, open a window and wait for it.

    The run is laid over `other`, or over itself without control unless it is to be `alone`.
    Raises RecordingError if there is nothing to replay, the scene inside cannot be read, a
    file cannot be written or the viewer fails.
    """
    shown = prepare(recording, other, alone)
    if save is not None:
        rerun_replay.save(shown, save)
    if save is not None and picture is None:
        return
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        rrd = Path(folder) / f"{recording.path.stem}.rrd"
        rerun_replay.save(shown, rrd, still=picture is not None)
        if picture is None:
            viewer.show(rrd, shown.when.selection_ns[0])
        else:
            screenshot(rrd, picture, shown.when.still_ns)


def prepare(
    recording: Recording,
    other: Recording | None = None,
    alone: bool = False,
    drawn: str = "Faint",
) -> rerun_replay.Shown:
    """All that a replay shows; `drawn`: how curves of the other run look. Raises RecordingError."""
    # Deflections follow from all forces before them: where some are missing, the replay ends.
    recording = _whole(recording)
    rerun_replay.check_replayable(recording)
    setup = scene_of(recording)
    contacts = replay_data.contacts_of(recording.truth.pieces())
    plate = deflection(setup, recording, contacts=contacts)
    twin: tuple[replay_data.Twin, Overlay, float] | None = None
    lines: list[str] = []
    if other is not None:
        theirs, found, lines = _beside(recording, setup, contacts, other)
        twin = theirs, found, other.truth.step_ns * 1e-9
    elif not alone and setup.has_law:
        try:
            twin = *without_control(recording, setup, contacts), setup.step_s
            lines = [f"{drawn}: the same without control."]
        except SceneError as error:
            lines = [f"The run without control cannot be simulated: {error}"]
    told = _told(recording, setup, contacts, twin, lines)
    return rerun_replay.prepare(recording, plate, told, contacts)


def _whole(recording: Recording) -> Recording:
    """The part before a hole, in memory if it is short."""
    truth = recording.truth.before_gap().in_memory()
    return dataclasses.replace(recording, truth=truth, daq=recording.daq.in_memory())


def scene_of(recording: Recording) -> Setup:
    """The recorded scene. Raises RecordingError."""
    try:
        return parse(recording.scene_toml, recorded=True)
    except SceneError as error:
        words = f"the scene in {recording.path} cannot be read: {error}{recording.other_version}"
        raise RecordingError(words) from error


def without_control(
    recording: Recording, setup: Setup, contacts: list[replay_data.ContactSpan]
) -> tuple[replay_data.Twin, Overlay]:
    """The run without control, simulated here and now. Raises SceneError."""
    free = setup.without_control()
    found = overlay(free, free_series(free), _OF_TWIN, free.steps)
    twin, _ = _twin(recording, contacts, free, found, "", "no control")
    return twin, found


def _beside(
    recording: Recording, setup: Setup, contacts: list[replay_data.ContactSpan], other: Recording
) -> tuple[replay_data.Twin, Overlay, list[str]]:
    other = _whole(other)
    rerun_replay.check_replayable(other)
    theirs = scene_of(other)
    found = overlay(theirs, pieces_of(other), _OF_TWIN, other.truth.samples)
    twin, shift_ns = _twin(recording, contacts, theirs, found, "A", "B")
    lines = [
        f"A: {recording.path.name}. B, faint: {other.path.name}",
        *provenance.compared(setup, theirs),
    ]
    if shift_ns:
        lines.append(f"B is moved by {shift_ns * 1e-6:+z.3f} ms: first contacts begin together.")
    return twin, found, lines


def _twin(
    recording: Recording,
    contacts: list[replay_data.ContactSpan],
    setup: Setup,
    found: Overlay,
    own: str,
    name: str,
) -> tuple[replay_data.Twin, int]:
    """Curves of another run, and by how much they are moved for first contacts to begin together,
    ns; 0 where one of the runs has none."""
    truth, shift_ns = recording.truth, 0
    if contacts and found.touched is not None:
        begins_ns = int(truth.step_at(contacts[0].first)) * truth.step_ns
        shift_ns = begins_ns - found.touched * setup.step_ns
    curves: dict[str, list[replay_data.PlotCurve]] = {}
    for plot, signal, _, factor, held in replay_data.SIGNALS:
        line = found.lines[signal]
        if signal == "F_a" and not line.values.any():
            continue
        times = line.at * setup.step_ns + shift_ns
        curve = replay_data.curve_of(
            f"{signal}_twin", line, times, factor, held, f"{signal} {name}", True
        )
        curves.setdefault(plot, []).append(curve)
    line = found.lines["plate"]
    times = line.at * setup.step_ns + shift_ns
    curves["energy"] = [
        replay_data.curve_of("plate_twin", line, times, label=f"plate {name}", faint=True)
    ]
    return replay_data.Twin(curves, own, name), shift_ns


def _told(
    recording: Recording,
    setup: Setup,
    contacts: list[replay_data.ContactSpan],
    twin: tuple[replay_data.Twin, Overlay, float] | None,
    lines: list[str],
) -> Told:
    """`twin` with its curves and the length of its steps, s."""
    meter, truth = StabilityMeter(setup), recording.truth
    blocks = meter.through(pieces_of(recording))
    near = replay_data.full_rate_spans(
        [(contact.first, contact.end) for contact in contacts], truth.samples
    )
    begin = int(truth.step_at(0))
    spans = [(begin + a, begin + b) for a, b in near]
    own = overlay(setup, blocks, _ENERGIES, truth.samples, spans)
    described = provenance.description(setup, recording)
    told = [*described[:2], *lines, *described[2:]]
    if paced := pacing_of(recording):
        told += pacing_sentences(paced)[:2]
    since_s, until_ns = meter.result().since_s, LAST_NS
    if since_s is not None:
        until_ns = round(since_s * 1e9)
        told.insert(0, f"**Unstable** from {1e3 * since_s:z.3f} ms on")
    name = twin[0].own if twin and twin[0].own else "run"
    spectra = [spectrum(name, own.speed_m_s, setup.step_s)]
    if twin is not None:
        spectra.append(spectrum(twin[0].name, twin[1].speed_m_s, twin[2]))
    return Told(
        heading=recording.metadata.get("scene", recording.path.stem),
        lines=told,
        more_plots=[_energies(setup, own, twin[0] if twin else None, until_ns < LAST_NS)],
        spectra=[one for one in spectra if one is not None],
        twin=twin[0] if twin else None,
        actuator_m=None if not setup.has_law else setup.mechanics.actuator_point_m,
        controlled=setup.has_law,
        until_ns=until_ns,
    )


def _energies(
    setup: Setup, own: Overlay, twin: replay_data.Twin | None, explodes: bool
) -> replay_data.Plot:
    """The energy balance as a plot in a unit with readable numbers."""
    # Where the published scheme ends a contact, its sphere jumps.
    whole = SCHEMES[setup.scheme].conserves
    size_j = own.start_j if whole else float(np.max(own.lines["plate"].values, initial=0.0))
    factor, unit = next((f for f in _PREFIXES if size_j >= f[0]), _PREFIXES[-1])
    curves = [
        dataclasses.replace(curve, values=curve.values / factor)
        for curve in (twin.curves["energy"] if twin else [])
    ]
    for name, label in (_ENERGIES | {"sphere": setup.sphere.noun}).items():
        line = own.lines[name]
        known = whole or name in ("plate", "fed")
        if known and (name != "fed" or line.values.any()):
            times = line.at * setup.step_ns
            curves.append(replay_data.curve_of(name, line, times, 1.0 / factor, label=label))
    most = 3.0 * own.start_j / factor if explodes else None
    return replay_data.Plot("energy", f"Energies ({unit})", tuple(curves), most)
