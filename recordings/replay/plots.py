"""Plots of a replay: recorded signals as decimated curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.contacts import ContactSpan
from hertzloop.recordings.replay.decimation import Line, decimated

# Of truth: plot, curve, field, factor, held from one step to the next.
SIGNALS = (
    ("gap", "xi", "xi_m", 1e6, False),
    ("force", "F_c", "f_c_n", 1.0, True),
    ("force", "F_a", "f_a_n", 1.0, True),
    ("velocity", "v_p", "v_p_m_s", 1.0, False),
)


TITLES = {
    "gap": "Gap xi (µm)",
    "force": "Contact F_c, actuator F_a (N)",
    "velocity": "Plate velocity v_p (m/s)",
    "acceleration": "Plate acceleration (m/s²)",
    "late": "Force too old (steps)",
}
# Of a paced run, too: by how much the force that acted was too old.
LATE = ("late", "held", "held_steps", 1.0, True)


@dataclass(frozen=True)
class PlotCurve:
    """One line of a plot.

    Attributes:
        name: Name of its entity.
        time_ns: Simulated time, (samples,), ns.
        values: Values in the unit of the plot, (samples,).
        held: Whether it is constant from one sample to the next.
        label: Label in the legend, "" for the name.
        faint: Whether it is drawn faintly, to compare with.
        overview: Positions of the samples that suffice for the whole run, (points,); None for all.
    """

    name: str
    time_ns: np.ndarray
    values: np.ndarray
    held: bool = False
    label: str = ""
    faint: bool = False
    overview: np.ndarray | None = None


@dataclass(frozen=True)
class Plot:
    """Curves that share an axis.

    Attributes:
        key: Name of the entity of the plot.
        title: Title for people.
        curves: Its curves; later ones are drawn over earlier ones.
        most: Values above are not shown; None to show all.
    """

    key: str
    title: str
    curves: tuple[PlotCurve, ...]
    most: float | None = None


@dataclass(frozen=True)
class ReferenceRun:
    """Another run to compare with.

    Attributes:
        curves: Its curves by plot.
        own: What legends call the run itself, "" for nothing.
        name: What legends call the other run.
    """

    curves: dict[str, list[PlotCurve]]
    own: str
    name: str


def plots(
    recording: Recording, contacts: Sequence[ContactSpan], reference: ReferenceRun | None = None
) -> list[Plot]:
    """Gap, forces and plate velocity, with what the data acquisition saw where it belongs, and
    with the curves of the reference run; decimated away from contacts."""
    # Curves of the reference run come first: they lie behind.
    curves = {plot: list(reference.curves.get(plot, ())) if reference else [] for plot in TITLES}
    own = f" {reference.own}" if reference and reference.own else ""
    spans = [(contact.first, contact.end) for contact in contacts]
    signals = list(SIGNALS)
    if LATE[2] in recording.truth.arrays:
        signals.append(LATE)
    truth, daq = recording.truth, recording.daq
    for plot, name, field, factor, held in signals:
        line = decimated(truth.arrays[field], spans)
        times = line.at * truth.step_ns
        curves[plot].append(curve_of(name, line, times, factor, held, name + own))
    plot, factor = {
        "v_p": ("velocity", 1.0),
        "acceleration": ("acceleration", 1.0),
        "contact_force": ("force", 1.0),
    }.get(recording.scene_value("sensors", "quantity", "xi"), ("gap", 1e6))
    if daq.samples:
        # A converter may be slower than the plant.
        sampled = [(-(-a // daq.every_steps), -(-b // daq.every_steps)) for a, b in spans]
        line = decimated(daq.values, sampled)
        times = line.at * (daq.every_steps * daq.step_ns)
        curves[plot].append(curve_of("measured", line, times, factor, held=True))
    return [Plot(key, TITLES[key], tuple(found)) for key, found in curves.items() if found]


def curve_of(
    name: str,
    line: Line,
    time_ns: np.ndarray,
    factor: float = 1.0,
    held: bool = False,
    label: str = "",
    faint: bool = False,
) -> PlotCurve:
    """Return a decimated signal as a curve, in the plot's unit."""
    values = line.values if factor == 1.0 else factor * line.values
    return PlotCurve(name, time_ns, values, held, label, faint, line.overview)
