"""What a replay shows, as plain arrays: contacts, thinned curves, states, plate frames."""

import re
import tomllib
from dataclasses import dataclass
from typing import Any

import numpy as np

from bus.streams import LAST_NS
from recordings.reader import Recording

OVERVIEW_POINTS = 6000
OUTSIDE_POINTS = 40_000  # of a zoom curve, away from contacts
FULL_RATE_SAMPLES = 150_000  # of a zoom curve; more makes the viewer slow
_PADDING = 20_000  # samples at full rate before and after a contact, if the limit allows

Span = tuple[int, int]
# Of truth: plot, curve, field, factor, held from one step to the next.
SIGNALS = (
    ("gap", "xi", "xi_m", 1e6, False), ("force", "F_c", "f_c_n", 1.0, True),
    ("force", "F_a", "f_a_n", 1.0, True), ("velocity", "v_p", "v_p_m_s", 1.0, False),
)  # fmt: skip


@dataclass(frozen=True)
class Deflection:
    """Plate deflection as frames; up positive.

    `times_ns` (frames,), `x_m` (nx,) and `y_m` (ny,) ascending from edge to edge, `w_m`
    (frames, nx, ny). The contact point is a node of the grid.
    """

    times_ns: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    w_m: np.ndarray
    contact_point_m: tuple[float, float]

    @property
    def contact_node(self) -> tuple[int, int]:
        """Indices of the contact point in `x_m` and `y_m`."""
        x, y = self.contact_point_m
        return int(np.argmin(abs(self.x_m - x))), int(np.argmin(abs(self.y_m - y)))


@dataclass(frozen=True)
class Curve:
    """One line of a plot: `time_ns` and `values`, both (samples,), in the plot's unit.

    `name` is its entity's, `label` what the legend says; a `faint` one is there to compare with.
    """

    name: str
    time_ns: np.ndarray
    values: np.ndarray
    held: bool = False  # constant from one sample to the next
    label: str = ""
    faint: bool = False


@dataclass(frozen=True)
class Plot:
    """Curves that share an axis; `key` names the entities, `title` is for people; what is beyond
    `most` is not shown."""

    key: str
    title: str
    curves: tuple[Curve, ...]
    most: float | None = None


@dataclass(frozen=True)
class Twin:
    """Another run to compare with: its curves by plot. `own`, `name`: what legends call the run
    itself ("" for nothing) and the other."""

    curves: dict[str, list[Curve]]
    own: str
    name: str


def _scene(recording: Recording) -> dict[str, Any]:
    try:
        return tomllib.loads(recording.scene_toml)
    except tomllib.TOMLDecodeError:
        return {}


def scene_value(recording: Recording, table: str, key: str, default: Any = None) -> Any:
    """A value of the recorded scene, `default` where it is not said or not readable."""
    return _scene(recording).get(table, {}).get(key, default)


def contact_spans(xi_m: np.ndarray) -> list[Span]:
    """First step in contact and first step after it, for every contact, from the gap (steps,)."""
    touching = np.concatenate([[0], (xi_m < 0.0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(touching))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


@dataclass(frozen=True)
class Moments:
    """When something is worth looking at, ns: what play shows, what zoom plots reach before
    and after the cursor, and the time of a still picture."""

    selection_ns: Span
    zoom_ns: Span
    still_ns: int


def moments(
    time_ns: np.ndarray, contacts: list[Span], step_ns: int, until_ns: int = LAST_NS
) -> Moments:
    """Moments around the first contact, before a loop explodes at `until_ns`; without a contact,
    the whole recording (times (steps,))."""
    first, last = int(time_ns[0]), min(int(time_ns[-1]), until_ns)
    if not contacts:
        half = max(last - first, step_ns) // 2
        return Moments((first, max(last, first + step_ns)), (half, half), (first + last) // 2)
    start, end = contacts[0]
    begun, length = min(int(time_ns[start]), last), max(end - start, 4) * step_ns
    selection = (max(first, begun - length), min(last, begun + 9 * length))
    still, after = begun + 2 * length, min(3 * length, last - first) // 2
    if still > last:  # the run ends in this contact, or soon after it
        still = begun + 2 * (last - begun) // 3
    if until_ns < LAST_NS or still + after > last:
        after = max(min(after, last - still), step_ns)
    before = still - begun + min(length // 2, max(begun - first, length // 8))
    return Moments(selection, (before, after), still)


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Ascending positions of at most about `points` samples that keep each minimum and maximum
    of equal pieces, and both ends."""
    count = len(values)
    width = -(-2 * count // points)
    if width <= 2:
        return np.arange(count)
    whole = count // width * width
    starts = np.arange(0, whole, width)
    pieces = values[:whole].reshape(-1, width)
    kept = [np.array([0, count - 1])]
    kept += [starts + pieces.argmin(axis=1), starts + pieces.argmax(axis=1)]
    if rest := count - whole:
        kept += [whole + np.array([values[-rest:].argmin(), values[-rest:].argmax()])]
    shown = np.zeros(count, bool)
    shown[np.concatenate(kept)] = True
    return np.flatnonzero(shown)


def full_rate_spans(contacts: list[Span], count: int) -> list[Span]:
    """Samples shown at full rate: everything in a short run, else the surroundings of contacts.

    At most `FULL_RATE_SAMPLES` in all; the earliest contacts come first.
    """
    if count <= FULL_RATE_SAMPLES:
        return [(0, count)] if count else []
    left = FULL_RATE_SAMPLES
    padding = min(_PADDING, left // (4 * max(1, len(contacts))))
    spans: list[Span] = []
    for start, end in contacts:
        first = max(spans[-1][1] if spans else 0, start - padding)
        last = min(count, end + padding, first + left)
        if first < last:
            spans.append((first, last))
            left -= last - first
    return spans


def zoom_positions(values: np.ndarray, spans: list[Span]) -> np.ndarray:
    """Positions of the samples of a zoom curve: all within `spans`, extremes elsewhere."""
    shown = np.zeros(len(values), bool)
    shown[extremes(values, OUTSIDE_POINTS)] = True
    for first, end in spans:
        shown[first:end] = True
    return np.flatnonzero(shown)


def plots(recording: Recording, twin: Twin | None = None) -> list[Plot]:
    """Gap, forces and plate velocity, with what the data acquisition saw where it belongs, and
    with the twin's."""
    curves: dict[str, list[Curve]] = {"gap": [], "force": [], "velocity": [], "acceleration": []}
    if twin is not None:  # first, to lie behind
        for plot in curves:
            curves[plot] += twin.curves.get(plot, [])
    times = recording.truth.time_ns
    own = f" {twin.own}" if twin and twin.own else ""
    for plot, name, field, factor, held in SIGNALS:
        values = recording.truth.arrays[field]
        if factor != 1.0:
            values = factor * values
        curves[plot].append(Curve(name, times, values, held, name + own))
    plot, factor = {
        "v_p": ("velocity", 1.0), "acceleration": ("acceleration", 1.0),
        "contact_force": ("force", 1.0),
    }.get(scene_value(recording, "sensors", "quantity", "xi"), ("gap", 1e6))  # fmt: skip
    if recording.daq.samples:
        values = recording.daq_values
        if factor != 1.0:
            values = factor * values
        daq, truth = recording.daq, recording.truth
        alike = (daq.every_steps, daq.samples, daq.first_step, daq.resumed) == (
            1, truth.samples, truth.first_step, truth.resumed,
        )  # fmt: skip
        sampled_ns = times if alike else daq.time_ns
        curves[plot].append(Curve("measured", sampled_ns, values, held=True))
    titles = {
        "gap": "Gap xi (µm)",
        "force": "Contact F_c, actuator F_a (N)",
        "velocity": "Plate velocity v_p (m/s)",
        "acceleration": "Plate acceleration (m/s²)",
    }
    return [Plot(key, titles[key], tuple(found)) for key, found in curves.items() if found]


def law_states(recording: Recording) -> list[tuple[int, str]]:
    """Time in ns and name of each state of the force law, from the controller's events; of a law
    that is not the scene's nothing is known without."""
    law = scene_value(recording, "controller", "law", "")
    end = recording.ends.get("controller")
    states: list[tuple[int, str]] = []
    for event in recording.events:
        change = re.match(r"law (\w+) -> (\w+)", event.message)
        if event.name == "controller" and change:
            if not states:
                states.append((0, change[1]))
            states.append((event.time_ns, change[2]))
    if not states and end and end.set_up.law not in ("", law):
        return [(0, "not told")]
    return states or [(0, "off" if law == "off" else "idle")]
