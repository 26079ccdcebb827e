"""Everything that a replay shows of a run, computed once."""

from dataclasses import dataclass, field

import numpy as np

from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay import scene3d
from hertzloop.recordings.replay.contacts import ContactSpan, contacts_of
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.moments import Moments, moments
from hertzloop.recordings.replay.plots import Plot, ReferenceRun, plots
from hertzloop.recordings.replay.spectrum import Spectrum
from hertzloop.recordings.writer import RecordingError


@dataclass(frozen=True)
class ReplayLabels:
    """What a replay shows beside the contents of the recording.

    Attributes:
        heading: Heading of the text, "" for the name of the scene.
        lines: Lines that describe the run, as markdown.
        more_plots: Plots below the recorded signals.
        spectra: Spectra below the plots.
        reference: The run to compare with; None without one.
        actuator_m: Place of the actuator, x and y; None without one.
        controlled: Whether there is a law.
        until_ns: Time at which an unstable loop explodes, ns.
    """

    heading: str = ""
    lines: list[str] = field(default_factory=list)
    more_plots: list[Plot] = field(default_factory=list)
    spectra: list[Spectrum] = field(default_factory=list)
    reference: ReferenceRun | None = None
    actuator_m: tuple[float, float] | None = None
    controlled: bool = True
    until_ns: int = LAST_NS


@dataclass(frozen=True)
class ReplayData:
    """What a replay shows.

    Attributes:
        recording: The recording.
        deflection: Deflection of the plate at the frames.
        contacts: All contacts.
        when: Moments that are worth looking at.
        plots: All plots, from top to bottom.
        drawn: Scale of the drawing.
        at_frames: Lowest point of the sphere, gap and actuator force by field, (frames,) each.
        sphere_radius_m: Radius of the sphere.
        labels: What is shown beside the contents of the recording.
    """

    recording: Recording
    deflection: Deflection
    contacts: list[ContactSpan]
    when: Moments
    plots: list[Plot]
    drawn: scene3d.Scale
    at_frames: dict[str, np.ndarray]
    sphere_radius_m: float
    labels: ReplayLabels


def prepare(
    recording: Recording,
    deflection: Deflection,
    labels: ReplayLabels | None = None,
    contacts: list[ContactSpan] | None = None,
) -> ReplayData:
    """Compute what a replay shows.

    Args:
        recording: A recording of at least one step, see `check_replayable`.
        deflection: Deflection of the plate at the frames.
        labels: What is shown beside the contents of the recording.
        contacts: All contacts, if they are known.
    """
    truth, labels = recording.truth, labels or ReplayLabels()
    if contacts is None:
        contacts = contacts_of(truth)
    touching = None
    if contacts:
        begun = contacts[0].first * truth.step_ns
        touching = begun, begun + (contacts[0].end - contacts[0].first) * truth.step_ns
    when = moments(
        (0, (truth.samples - 1) * truth.step_ns), touching, truth.step_ns, labels.until_ns
    )
    radius = float(recording.scene_value("sphere", "radius_m", 0.0))
    drawn = scene3d.scale(deflection, when.selection_ns, radius)
    all_plots = [*plots(recording, contacts, labels.reference), *labels.more_plots]
    frames = deflection.times_ns // truth.step_ns
    at_frames = {name: truth.arrays[name][frames] for name in ("xi_s_m", "xi_m", "f_a_n")}
    return ReplayData(
        recording, deflection, contacts, when, all_plots, drawn, at_frames, radius, labels
    )


def check_replayable(recording: Recording) -> None:
    """Raise RecordingError if the recording holds no step."""
    if not recording.truth.samples:
        raise RecordingError(
            f"{recording.path} holds no step of the simulation: there is nothing to replay"
        )
