"""Replay of a recording: a file for the Rerun viewer, a picture, or a window."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

from hertzloop.bus.streams import LAST_NS
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay import as_rerun, viewer
from hertzloop.recordings.replay.contacts import ContactSpan, contacts_of
from hertzloop.recordings.replay.decimation import full_rate_spans
from hertzloop.recordings.replay.plots import SIGNALS, Plot, PlotCurve, ReferenceRun, curve_of
from hertzloop.recordings.replay.replay_data import ReplayData, ReplayLabels, check_replayable
from hertzloop.recordings.replay.replay_data import prepare as prepare_replay
from hertzloop.recordings.replay.spectrum import spectrum
from hertzloop.recordings.replay.viewer import screenshot
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.curves import Overlay, overlay
from hertzloop.results.deflection import deflection
from hertzloop.results.recorded import pacing_of, pieces_of
from hertzloop.results.stability import StabilityAccumulator
from hertzloop.scene.build import free_series
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.views import provenance
from hertzloop.views.pacing import pacing_sentences

has_display = viewer.has_display
_OF_REFERENCE = ("xi", "F_c", "F_a", "v_p", "plate")
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
        as_rerun.save(shown, save)
    if save is not None and picture is None:
        return
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        rrd = Path(folder) / f"{recording.path.stem}.rrd"
        as_rerun.save(shown, rrd, still=picture is not None)
        if picture is None:
            viewer.show(rrd, shown.when.selection_ns[0])
        else:
            screenshot(rrd, picture, shown.when.still_ns)


def prepare(
    recording: Recording,
    other: Recording | None = None,
    alone: bool = False,
    drawn: str = "Faint",
) -> ReplayData:
    """All that a replay shows; `drawn`: how curves of the other run look. Raises RecordingError."""
    # Deflections follow from all forces before them: where some are missing, the replay ends.
    recording = _whole(recording)
    check_replayable(recording)
    setup = scene_of(recording)
    contacts = contacts_of(recording.truth.pieces())
    plate = deflection(setup, recording, contacts=contacts)
    reference: tuple[ReferenceRun, Overlay, float] | None = None
    lines: list[str] = []
    if other is not None:
        theirs, found, lines = _beside(recording, setup, contacts, other)
        reference = theirs, found, other.truth.step_ns * 1e-9
    elif not alone and setup.has_law:
        try:
            reference = *without_control(recording, setup, contacts), setup.step_s
            lines = [f"{drawn}: the same without control."]
        except SceneError as error:
            lines = [f"The run without control cannot be simulated: {error}"]
    labels = _labels(recording, setup, contacts, reference, lines)
    return prepare_replay(recording, plate, labels, contacts)


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
    recording: Recording, setup: Setup, contacts: list[ContactSpan]
) -> tuple[ReferenceRun, Overlay]:
    """The run without control, simulated here and now. Raises SceneError."""
    free = setup.without_control()
    found = overlay(free, free_series(free), _OF_REFERENCE, free.steps)
    reference, _ = _reference(recording, contacts, free, found, "", "no control")
    return reference, found


def _beside(
    recording: Recording, setup: Setup, contacts: list[ContactSpan], other: Recording
) -> tuple[ReferenceRun, Overlay, list[str]]:
    other = _whole(other)
    check_replayable(other)
    theirs = scene_of(other)
    found = overlay(theirs, pieces_of(other), _OF_REFERENCE, other.truth.samples)
    reference, shift_ns = _reference(recording, contacts, theirs, found, "A", "B")
    lines = [
        f"A: {recording.path.name}. B, faint: {other.path.name}",
        *provenance.compared(setup, theirs),
    ]
    if shift_ns:
        lines.append(f"B is moved by {shift_ns * 1e-6:+z.3f} ms: first contacts begin together.")
    return reference, found, lines


def _reference(
    recording: Recording,
    contacts: list[ContactSpan],
    setup: Setup,
    found: Overlay,
    own: str,
    name: str,
) -> tuple[ReferenceRun, int]:
    """Curves of another run, and by how much they are moved for first contacts to begin together,
    ns; 0 where one of the runs has none."""
    truth, shift_ns = recording.truth, 0
    if contacts and found.touched is not None:
        begins_ns = int(truth.step_at(contacts[0].first)) * truth.step_ns
        shift_ns = begins_ns - found.touched * setup.step_ns
    curves: dict[str, list[PlotCurve]] = {}
    for plot, signal, _, factor, held in SIGNALS:
        line = found.lines[signal]
        if signal == "F_a" and not line.values.any():
            continue
        times = line.at * setup.step_ns + shift_ns
        curve = curve_of(f"{signal}_reference", line, times, factor, held, f"{signal} {name}", True)
        curves.setdefault(plot, []).append(curve)
    line = found.lines["plate"]
    times = line.at * setup.step_ns + shift_ns
    curves["energy"] = [curve_of("plate_reference", line, times, label=f"plate {name}", faint=True)]
    return ReferenceRun(curves, own, name), shift_ns


def _labels(
    recording: Recording,
    setup: Setup,
    contacts: list[ContactSpan],
    reference: tuple[ReferenceRun, Overlay, float] | None,
    lines: list[str],
) -> ReplayLabels:
    """`reference` with its curves and the length of its steps, s."""
    accumulator, truth = StabilityAccumulator(setup), recording.truth
    blocks = accumulator.through(pieces_of(recording))
    near = full_rate_spans([(contact.first, contact.end) for contact in contacts], truth.samples)
    begin = int(truth.step_at(0))
    spans = [(begin + a, begin + b) for a, b in near]
    own = overlay(setup, blocks, _ENERGIES, truth.samples, spans)
    described = provenance.description(setup, recording)
    described_lines = [*described[:2], *lines, *described[2:]]
    if paced := pacing_of(recording):
        described_lines += pacing_sentences(paced)[:2]
    since_s, until_ns = accumulator.result().since_s, LAST_NS
    if since_s is not None:
        until_ns = round(since_s * 1e9)
        described_lines.insert(0, f"**Unstable** from {1e3 * since_s:z.3f} ms on")
    name = reference[0].own if reference and reference[0].own else "run"
    spectra = [spectrum(name, own.speed_m_s, setup.step_s)]
    if reference is not None:
        spectra.append(spectrum(reference[0].name, reference[1].speed_m_s, reference[2]))
    return ReplayLabels(
        heading=recording.metadata.get("scene", recording.path.stem),
        lines=described_lines,
        more_plots=[_energies(setup, own, reference[0] if reference else None, until_ns < LAST_NS)],
        spectra=[one for one in spectra if one is not None],
        reference=reference[0] if reference else None,
        actuator_m=None if not setup.has_law else setup.mechanics.actuator_point_m,
        controlled=setup.has_law,
        until_ns=until_ns,
    )


def _energies(setup: Setup, own: Overlay, reference: ReferenceRun | None, explodes: bool) -> Plot:
    """The energy balance as a plot in a unit with readable numbers."""
    # Where the published scheme ends a contact, its sphere jumps.
    whole = SCHEMES[setup.scheme].conserves
    size_j = own.start_j if whole else float(np.max(own.lines["plate"].values, initial=0.0))
    factor, unit = next((f for f in _PREFIXES if size_j >= f[0]), _PREFIXES[-1])
    curves = [
        dataclasses.replace(curve, values=curve.values / factor)
        for curve in (reference.curves["energy"] if reference else [])
    ]
    for name, label in (_ENERGIES | {"sphere": setup.sphere.noun}).items():
        line = own.lines[name]
        known = whole or name in ("plate", "fed")
        if known and (name != "fed" or line.values.any()):
            times = line.at * setup.step_ns
            curves.append(curve_of(name, line, times, 1.0 / factor, label=label))
    most = 3.0 * own.start_j / factor if explodes else None
    return Plot("energy", f"Energies ({unit})", tuple(curves), most)
