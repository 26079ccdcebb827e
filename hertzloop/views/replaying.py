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
from hertzloop.recordings.replay.decimation import decimated
from hertzloop.recordings.replay.plots import SIGNALS, Plot, PlotCurve, ReferenceRun, curve_of
from hertzloop.recordings.replay.replay_data import ReplayData, ReplayLabels, check_replayable
from hertzloop.recordings.replay.replay_data import prepare as prepare_replay
from hertzloop.recordings.replay.screenshot import screenshot
from hertzloop.recordings.replay.spectrum import spectrum
from hertzloop.results.curves import Overlay, overlay
from hertzloop.results.deflection import deflection
from hertzloop.results.inspection import inspected
from hertzloop.results.recorded import pacing_of, setup_of, truth_of
from hertzloop.results.statistics import stability_of
from hertzloop.scene.build import free_series
from hertzloop.scene.controller import latencies_us
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.views import provenance
from hertzloop.views.digits import shown_unit
from hertzloop.views.pacing import lateness_sentences
from hertzloop.views.verdict import verdict_sentences

has_display = viewer.has_display
_OF_REFERENCE = ("xi", "F_c", "F_a", "v_p", "plate")
_ENERGIES = {
    "sphere": "sphere",
    "plate": "plate",
    "contact": "contact",
    "fed": "fed in by actuator",
}


def replay(
    recording: Recording,
    save: Path | None,
    picture: Path | None,
    other: Recording | None = None,
    alone: bool = False,
) -> None:
    """Write a replay to files; without a file, open a window and wait until it is closed.

    Args:
        recording: The recording.
        save: File for the Rerun viewer (.rrd).
        picture: Picture of the first contact (.png).
        other: Recording to compare with; None: the run without control.
        alone: Whether the recording is shown without a comparison.

    Raises:
        RecordingError: There is nothing to replay, the scene inside cannot be read, a file cannot
            be written, or the viewer fails.
    """
    data = prepare(recording, other, alone)
    if save is not None:
        as_rerun.save(data, save)
    if save is not None and picture is None:
        return
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        rrd = Path(folder) / f"{recording.path.stem}.rrd"
        as_rerun.save(data, rrd, still=picture is not None)
        if picture is None:
            viewer.show(rrd, data.when.selection_ns[0])
        else:
            screenshot(rrd, picture, data.when.still_ns)


def prepare(
    recording: Recording,
    other: Recording | None = None,
    alone: bool = False,
    drawn: str = "Faint",
    verdict: bool = True,
) -> ReplayData:
    """Return the data of a replay.

    Args:
        recording: The recording.
        other: Recording to compare with; None: the run without control.
        alone: Whether the recording is shown without a comparison.
        drawn: How the curves of the run without control look, in a word.
        verdict: Whether the text begins with the verdict on the run against that without control.

    Raises:
        RecordingError: There is nothing to replay, or the scene inside cannot be read.
    """
    check_replayable(recording)
    setup = setup_of(recording)
    contacts = contacts_of(recording.truth)
    plate = deflection(setup, recording, contacts=contacts)
    reference: _Reference | None = None
    lines: list[str] = []
    sentences: list[str] = []
    if other is not None:
        reference, lines = _other_recording(recording, setup, contacts, other)
    elif not alone and setup.scene.controller.has_law:
        try:
            reference = _without_control(recording, setup, contacts)
            lines = [f"{drawn}: the same without control."]
            if verdict:
                found = inspected(recording, against_none=True).assessment
                sentences = verdict_sentences(found) if found else []
        except SceneError as error:
            lines = [f"The run without control cannot be simulated: {error}"]
    labels = _labels(recording, setup, contacts, reference, lines)
    labels = dataclasses.replace(labels, lines=[*sentences, *labels.lines])
    return prepare_replay(recording, plate, labels, contacts)


@dataclasses.dataclass(frozen=True)
class _Reference:
    """The run that a replay compares with.

    Attributes:
        run: Its curves, at the times of the recording.
        overlay: Its time series.
        step_s: Length of its steps, s.
    """

    run: ReferenceRun
    overlay: Overlay
    step_s: float


def _without_control(recording: Recording, setup: Setup, contacts: list[ContactSpan]) -> _Reference:
    """Simulate the run without control. Raises SceneError."""
    free = setup.without_control()
    found = overlay(free, free_series(free), _OF_REFERENCE)
    curves, _ = _curves(found, free.run.step_ns, _touch_ns(recording, contacts), "no control")
    return _Reference(ReferenceRun(curves, "", "no control"), found, setup.run.step_s)


def _other_recording(
    recording: Recording, setup: Setup, contacts: list[ContactSpan], other: Recording
) -> tuple[_Reference, list[str]]:
    """Return another recording to compare with, and lines that name both."""
    check_replayable(other)
    theirs = setup_of(other)
    found = overlay(theirs, truth_of(other), _OF_REFERENCE)
    curves, shift_ns = _curves(found, theirs.run.step_ns, _touch_ns(recording, contacts), "B")
    lines = [
        f"A: {recording.path.name}. B, faint: {other.path.name}",
        *provenance.compared(setup, theirs),
    ]
    if shift_ns:
        lines.append(f"B is moved by {shift_ns * 1e-6:+z.3f} ms: first contacts begin together.")
    step_s = other.truth.step_ns * 1e-9
    return _Reference(ReferenceRun(curves, "A", "B"), found, step_s), lines


def _touch_ns(recording: Recording, contacts: list[ContactSpan]) -> int | None:
    """Return when the first contact of a recording begins, ns; None without a contact."""
    if not contacts:
        return None
    return contacts[0].first * recording.truth.step_ns


def _curves(
    found: Overlay, step_ns: int, touch_ns: int | None, name: str
) -> tuple[dict[str, list[PlotCurve]], int]:
    """Return the curves of a reference run, and by how much they are shifted, ns.

    The shift lets the first contacts of both runs begin together; it is 0 if one has no contact.

    Args:
        found: Its time series.
        step_ns: Length of its steps, ns.
        touch_ns: Time at which its first contact is to begin, ns.
        name: Name of the run, for labels.
    """
    shift_ns = 0
    if touch_ns is not None and found.touched is not None:
        shift_ns = touch_ns - found.touched * step_ns
    curves: dict[str, list[PlotCurve]] = {}
    for plot, signal, _, factor, held in SIGNALS:
        line = found.lines[signal]
        if signal == "F_a" and not line.values.any():
            continue
        times = line.at * step_ns + shift_ns
        curve = curve_of(f"{signal}_reference", line, times, factor, held, f"{signal} {name}", True)
        curves.setdefault(plot, []).append(curve)
    line = found.lines["plate"]
    times = line.at * step_ns + shift_ns
    curves["energy"] = [curve_of("plate_reference", line, times, label=f"plate {name}", faint=True)]
    return curves, shift_ns


def _labels(
    recording: Recording,
    setup: Setup,
    contacts: list[ContactSpan],
    reference: _Reference | None,
    lines: list[str],
) -> ReplayLabels:
    """Return heading, description, energies and spectra of a replay."""
    truth = truth_of(recording)
    own = overlay(setup, truth, _ENERGIES)
    described = provenance.description(setup, recording)
    described_lines = [*described[:2], *lines, *described[2:]]
    if paced := pacing_of(recording):
        described_lines += lateness_sentences(paced)[:1]
    since_s, until_ns = stability_of(setup, truth).since_s, LAST_NS
    if since_s is not None:
        until_ns = round(since_s * 1e9)
        described_lines.insert(0, f"**Unstable** from {1e3 * since_s:z.3f} ms on")
    run = reference.run if reference else None
    spectra = [spectrum((run and run.own) or "run", own.speed_m_s, setup.run.step_s)]
    if reference:
        speed_m_s, step_s = reference.overlay.speed_m_s, reference.step_s
        spectra.append(spectrum(reference.run.name, speed_m_s, step_s))
    more_plots = [_energies(setup, own, run, until_ns < LAST_NS)]
    if setup.scene.controller.has_law and setup.signal_path.varies and recording.daq.samples:
        more_plots.append(_latencies(setup, recording.daq.samples))
    return ReplayLabels(
        heading=recording.metadata.get("scene", recording.path.stem),
        lines=described_lines,
        more_plots=more_plots,
        spectra=[one for one in spectra if one is not None],
        reference=run,
        actuator_m=None if not setup.scene.controller.has_law else setup.mechanics.actuator_point_m,
        controlled=setup.scene.controller.has_law,
        until_ns=until_ns,
    )


def _latencies(setup: Setup, samples: int) -> Plot:
    """Return the latencies of the first commands of a run as a plot."""
    values = latencies_us(setup)[:samples]
    line = decimated(values, [])
    times = line.at * setup.sensor.every_steps * setup.run.step_ns
    return Plot("latency", "Latency of commands (µs)", (curve_of("latency", line, times),))


def _energies(setup: Setup, own: Overlay, reference: ReferenceRun | None, explodes: bool) -> Plot:
    """Return the energy balance as a plot, in a unit with readable numbers."""
    # The sphere of the published scheme jumps at the end of a contact.
    conserves = SCHEMES[setup.run.scheme].conserves
    size_j = own.start_j if conserves else float(np.max(own.lines["plate"].values, initial=0.0))
    factor, unit = shown_unit("J", [size_j])
    curves = [
        dataclasses.replace(curve, values=curve.values * factor)
        for curve in (reference.curves["energy"] if reference else [])
    ]
    for name, label in _ENERGIES.items():
        line = own.lines[name]
        known = conserves or name in ("plate", "fed")
        if known and (name != "fed" or line.values.any()):
            times = line.at * setup.run.step_ns
            curves.append(curve_of(name, line, times, factor, label=label))
    most = 3.0 * own.start_j * factor if explodes else None
    return Plot("energy", f"Energies ({unit.replace('u', 'µ')})", tuple(curves), most)
