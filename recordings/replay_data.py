"""What a replay shows, as plain arrays: contacts, thinned curves, states, plate frames."""

import re
import tomllib
from dataclasses import dataclass
from typing import Any

import numpy as np

from recordings.reader import Recording

OVERVIEW_POINTS = 6000
OUTSIDE_POINTS = 40_000  # of a zoom curve, away from contacts
FULL_RATE_SAMPLES = 150_000  # of a zoom curve; more makes the viewer slow
_PADDING = 20_000  # samples at full rate before and after a contact, if the limit allows

Span = tuple[int, int]


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
    """One line of a plot: `time_ns` and `values`, both (samples,), in the plot's unit."""

    name: str
    time_ns: np.ndarray
    values: np.ndarray
    held: bool = False  # constant from one sample to the next


@dataclass(frozen=True)
class Plot:
    """Curves that share an axis; `key` names the entities, `title` is for people."""

    key: str
    title: str
    curves: tuple[Curve, ...]


def _scene(recording: Recording) -> dict[str, Any]:
    try:
        return tomllib.loads(recording.scene_toml)
    except tomllib.TOMLDecodeError:
        return {}


def scene_value(recording: Recording, table: str, key: str, default: Any = None) -> Any:
    """A value of the recorded scene, `default` where it is not said or not readable."""
    return _scene(recording).get(table, {}).get(key, default)


def scene_shows(recording: Recording) -> str:
    """What the recorded scene says it shows, may be empty."""
    return str(_scene(recording).get("shows", ""))


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


def moments(time_ns: np.ndarray, contacts: list[Span], step_ns: int) -> Moments:
    """Moments around the first contact; without one, the whole recording (times (steps,))."""
    first, last = int(time_ns[0]), int(time_ns[-1])
    if not contacts:
        half = max(last - first, step_ns) // 2
        return Moments((first, max(last, first + step_ns)), (half, half), (first + last) // 2)
    start, end = contacts[0]
    begun, length = int(time_ns[start]), max(end - start, 4) * step_ns
    selection = (max(first, begun - length), min(last, begun + 9 * length))
    zoom = (min(5 * length, last - first) // 2, min(3 * length, last - first) // 2)
    return Moments(selection, zoom, min(last, begun + 2 * length))


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
    return np.unique(np.concatenate(kept))


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
    inside = [np.arange(first, end) for first, end in spans]
    return np.unique(np.concatenate([extremes(values, OUTSIDE_POINTS), *inside]))


def plots(recording: Recording) -> list[Plot]:
    """Gap, forces and plate velocity, with what the data acquisition saw where it belongs."""
    truth, time_ns = recording.truth, recording.truth.time_ns

    def true(name: str, field: str, factor: float = 1.0, held: bool = False) -> Curve:
        return Curve(name, time_ns, factor * truth.arrays[field], held)

    curves = {
        "gap": [true("xi", "xi_m", 1e6)],
        "force": [true("F_c", "f_c_n", held=True), true("F_a", "f_a_n", held=True)],
        "velocity": [true("v_p", "v_p_m_s")],
        "acceleration": [],
    }
    plot, factor = {
        "v_p": ("velocity", 1.0), "acceleration": ("acceleration", 1.0),
        "contact_force": ("force", 1.0),
    }.get(scene_value(recording, "sensors", "quantity", "xi"), ("gap", 1e6))  # fmt: skip
    if recording.daq.samples:
        values = factor * recording.daq_values
        curves[plot].append(Curve("measured", recording.daq.time_ns, values, held=True))
    titles = {
        "gap": "Gap xi (µm)",
        "force": "Forces F_c, F_a (N)",
        "velocity": "Plate velocity v_p (m/s)",
        "acceleration": "Plate acceleration (m/s²)",
    }
    return [Plot(key, titles[key], tuple(found)) for key, found in curves.items() if found]


def law_states(recording: Recording) -> list[tuple[int, str]]:
    """Time in ns and name of each state of the force law, from the controller's events."""
    law = scene_value(recording, "controller", "law", "")
    states: list[tuple[int, str]] = []
    for event in recording.events:
        change = re.match(r"law (\w+) -> (\w+)", event.message)
        if event.name == "controller" and change:
            if not states:
                states.append((0, change[1]))
            states.append((event.time_ns, change[2]))
    return states or [(0, "off" if law == "off" else "idle")]
