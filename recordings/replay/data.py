"""What a replay shows, as plain arrays: contacts, thinned curves, states, plate frames."""

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.bus.events import mode_name
from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.joined_stream import Arrays, JoinedStream
from hertzloop.recordings.recording import Recording

# What a replay keeps of a run, found as its samples come: contacts, thinned lines, single rows.
#
# A long run takes the memory of a short one this way.

OVERVIEW_POINTS = 6000
OUTSIDE_POINTS = 40_000  # of a zoom curve, away from contacts
FULL_RATE_SAMPLES = 150_000  # of a zoom curve; more makes the viewer slow
_PADDING = 20_000  # samples at full rate before and after a contact, if the limit allows

Span = tuple[int, int]


@dataclass(frozen=True)
class ContactSpan:
    """Positions of the first sample in contact and of the first one after it; largest force and
    penetration in between, N and m."""

    first: int
    end: int
    peak_n: float
    deepest_m: float

    def joined(self, later: "ContactSpan") -> "ContactSpan":
        """Both as one."""
        return ContactSpan(
            self.first,
            later.end,
            max(self.peak_n, later.peak_n),
            max(self.deepest_m, later.deepest_m),
        )


def contact_spans(xi_m: np.ndarray) -> list[Span]:
    """First step in contact and first step after it, for every contact, from the gap (steps,)."""
    touching = np.concatenate([[0], (xi_m < 0.0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(touching))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def contacts_of(pieces: Iterable[tuple[int, Arrays]]) -> list[ContactSpan]:
    """Contacts of a run from pieces of its truth, each with the position of its first row."""
    found: list[ContactSpan] = []
    for at, arrays in pieces:
        xi, force = arrays["xi_m"], arrays["f_c_n"]
        for a, b in contact_spans(xi):
            deepest, peak = -float(xi[a:b].min()), float(force[a:b].max())
            contact = ContactSpan(at + a, at + b, peak, deepest)
            if found and found[-1].end == contact.first:
                found[-1] = found[-1].joined(contact)
            else:
                found.append(contact)
    return found


def rows_at(stream: JoinedStream, positions: np.ndarray, names: Sequence[str]) -> Arrays:
    """The samples at ascending positions, each array (positions,)."""
    found: dict[str, list[np.ndarray]] = {name: [np.empty(0)] for name in names}
    for at, arrays in stream.pieces():
        count = len(next(iter(arrays.values())))
        a, b = np.searchsorted(positions, (at, at + count))
        for name, parts in found.items():
            parts.append(arrays[name][positions[a:b] - at])
    return {name: np.concatenate(parts) for name, parts in found.items()}


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


def enough(time_ns: np.ndarray, values: np.ndarray, within: float, held: bool) -> np.ndarray:
    """Ascending positions of samples between which straight lines keep within so much of all
    values, or, if they are `held`, the value before."""
    kept = np.ones(len(values), bool)
    time, width = time_ns.astype(float), 1
    good: np.ndarray = np.ones(max(len(values) - 1, 0), bool)  # pieces so wide
    while len(good) > 1:
        good = good[:-1:2] & good[1::2]
        width *= 2
        tried = np.flatnonzero(good)
        at = tried[:, None] * width + np.arange(width + 1)
        value, when = values[at], time[at] - time[at[:, :1]]
        with np.errstate(invalid="ignore", over="ignore"):  # of values without bound
            slope = 0.0 if held else (value[:, -1:] - value[:, :1]) / when[:, -1:]
            error = abs(value[:, :1] + slope * when - value)[:, :-1].max(axis=1, initial=0.0)
        good[tried] = error <= within
        kept[at[good[tried], 1:-1]] = False
    return np.flatnonzero(kept)


def full_rate_spans(contacts: Sequence[Span], count: int) -> list[Span]:
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
        if not left:
            break
    return spans


@dataclass(frozen=True)
class Line:
    """A thinned signal: `at` (kept,) ascending positions of what is kept, `values` (kept,), and
    which of these are enough for all of it at once, `overview` (points,)."""

    at: np.ndarray
    values: np.ndarray
    overview: np.ndarray


def within(spans: Sequence[Span], first: int, count: int) -> np.ndarray:
    """Which of `count` positions from `first` on lie in spans (ascending, apart)."""
    found = np.zeros(count, bool)
    ends = np.array(spans, np.int64).reshape(-1, 2)[:, 1]
    for a, b in spans[int(np.searchsorted(ends, first, "right")) :]:
        if a >= first + count:
            break
        found[max(a - first, 0) : b - first] = True
    return found


class Thinner:
    """Keeps of a signal of `samples` values those that are marked, and smallest and largest of
    equal pieces elsewhere; all of a short one."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._at: list[np.ndarray] = []
        self._values: list[np.ndarray] = []
        self._overview: list[np.ndarray] = []
        self._kept = 0

    def feed(self, first: int, values: np.ndarray, marked: np.ndarray) -> None:
        """The values from position `first` on; `marked`, of the same shape, are kept."""
        shown, whole = marked.copy(), extremes(values, self._share(len(values), OVERVIEW_POINTS))
        shown[whole] = True
        outside = self._share(len(values), OUTSIDE_POINTS)
        short = self._samples <= FULL_RATE_SAMPLES
        shown[slice(None) if short else extremes(values, outside)] = True
        kept = np.flatnonzero(shown)
        self._at.append(first + kept)
        self._values.append(values[kept])
        self._overview.append(self._kept + np.searchsorted(kept, whole))
        self._kept += len(kept)

    def _share(self, count: int, points: int) -> int:
        """Of so many points, those for `count` values."""
        return max(4, count * points // max(self._samples, 1))

    def line(self) -> Line:
        """What was kept."""
        if not self._at:
            nothing = np.empty(0, np.int64)
            return Line(nothing, np.empty(0), nothing)
        parts = (self._at, self._values, self._overview)
        return Line(*(np.concatenate(part) for part in parts))


# Of truth: plot, curve, field, factor, held from one step to the next.
SIGNALS = (
    ("gap", "xi", "xi_m", 1e6, False), ("force", "F_c", "f_c_n", 1.0, True),
    ("force", "F_a", "f_a_n", 1.0, True), ("velocity", "v_p", "v_p_m_s", 1.0, False),
)  # fmt: skip


TITLES = {
    "gap": "Gap xi (µm)", "force": "Contact F_c, actuator F_a (N)",
    "velocity": "Plate velocity v_p (m/s)", "acceleration": "Plate acceleration (m/s²)",
    "late": "Force too old (steps)",
}  # fmt: skip
# Of a paced run, too: by how much the force that acted was too old.
LATE = ("late", "held", "held_steps", 1.0, True)


@dataclass(frozen=True)
class Deflection:
    """Plate deflection as frames; up positive.

    `times_ns` (frames,), `x_m` (nx,) and `y_m` (ny,) ascending from edge to edge, `w_m`
    (frames, nx, ny). The contact point is a node of the grid. `known`: false where nothing says
    how the structure deflects, which is then drawn flat.
    """

    times_ns: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    w_m: np.ndarray
    contact_point_m: tuple[float, float]
    known: bool = True

    @property
    def low_m(self) -> tuple[float, float]:
        """The corner with the smallest coordinates."""
        return float(self.x_m[0]), float(self.y_m[0])

    @property
    def size_m(self) -> tuple[float, float]:
        """Lengths along x and y."""
        return float(self.x_m[-1] - self.x_m[0]), float(self.y_m[-1] - self.y_m[0])

    @property
    def contact_node(self) -> tuple[int, int]:
        """Indices of the contact point in `x_m` and `y_m`."""
        x, y = self.contact_point_m
        return int(np.argmin(abs(self.x_m - x))), int(np.argmin(abs(self.y_m - y)))


@dataclass(frozen=True)
class PlotCurve:
    """One line of a plot: `time_ns` and `values`, both (samples,), in the plot's unit.

    `name` is its entity's, `label` what the legend says; a `faint` one is there to compare with.
    `overview` (points,): which samples are enough for all of it at once, None for all.
    """

    name: str
    time_ns: np.ndarray
    values: np.ndarray
    held: bool = False  # constant from one sample to the next
    label: str = ""
    faint: bool = False
    overview: np.ndarray | None = None


@dataclass(frozen=True)
class Plot:
    """Curves that share an axis; `key` names the entities, `title` is for people; what is beyond
    `most` is not shown."""

    key: str
    title: str
    curves: tuple[PlotCurve, ...]
    most: float | None = None


@dataclass(frozen=True)
class Twin:
    """Another run to compare with: its curves by plot. `own`, `name`: what legends call the run
    itself ("" for nothing) and the other."""

    curves: dict[str, list[PlotCurve]]
    own: str
    name: str


def scene_value(recording: Recording, table: str, key: str, default: Any = None) -> Any:
    """A value of the recorded scene, `default` where it is not said or not readable."""
    try:
        return tomllib.loads(recording.scene_toml).get(table, {}).get(key, default)
    except tomllib.TOMLDecodeError:
        return default


@dataclass(frozen=True)
class Moments:
    """When something is worth looking at, ns: what play shows, what zoom plots reach before
    and after the cursor, and the time of a still picture."""

    selection_ns: Span
    zoom_ns: Span
    still_ns: int

    @property
    def around_ns(self) -> Span:
        """What zoom plots show in a still picture."""
        return self.still_ns - self.zoom_ns[0], self.still_ns + self.zoom_ns[1]


def moments(
    run_ns: Span, contact_ns: Span | None, step_ns: int, until_ns: int = LAST_NS
) -> Moments:
    """Moments around the first contact, from its first step to the first one after it, before a
    loop explodes at `until_ns`; without a contact, the whole recording, its first and last step."""
    first, last = run_ns[0], min(run_ns[1], until_ns)
    if contact_ns is None:
        half = max(last - first, step_ns) // 2
        return Moments((first, max(last, first + step_ns)), (half, half), (first + last) // 2)
    start, end = contact_ns
    begun, length = min(start, last), max(end - start, 4 * step_ns)
    selection = (max(first, begun - length), min(last, begun + 9 * length))
    still, after = begun + 2 * length, min(3 * length, last - first) // 2
    if still > last:  # the run ends in this contact, or soon after it
        still = begun + 2 * (last - begun) // 3
    if until_ns < LAST_NS or still + after > last:
        after = max(min(after, last - still), step_ns)
    before = still - begun + min(length // 2, max(begun - first, length // 8))
    return Moments(selection, (before, after), still)


def plots(
    recording: Recording, contacts: Sequence[ContactSpan], twin: Twin | None = None
) -> list[Plot]:
    """Gap, forces and plate velocity, with what the data acquisition saw where it belongs, and
    with the twin's; thinned away from contacts."""
    # Those of the twin first, to lie behind.
    curves = {plot: list(twin.curves.get(plot, ())) if twin else [] for plot in TITLES}
    own = f" {twin.own}" if twin and twin.own else ""
    spans = [(contact.first, contact.end) for contact in contacts]
    signals = list(SIGNALS)
    if LATE[2] in recording.truth.arrays:
        signals.append(LATE)
    lines = _signals(recording, spans, [field for _, _, field, _, _ in signals])
    for (plot, name, _, factor, held), line in zip(signals, lines, strict=True):
        times = recording.truth.step_at(line.at) * recording.truth.step_ns
        curves[plot].append(curve_of(name, line, times, factor, held, name + own))
    plot, factor = {
        "v_p": ("velocity", 1.0), "acceleration": ("acceleration", 1.0),
        "contact_force": ("force", 1.0),
    }.get(scene_value(recording, "sensors", "quantity", "xi"), ("gap", 1e6))  # fmt: skip
    if recording.daq.samples:
        line = _measured(recording, spans)
        times = recording.daq.step_at(line.at) * recording.daq.step_ns
        curves[plot].append(curve_of("measured", line, times, factor, held=True))
    return [Plot(key, TITLES[key], tuple(found)) for key, found in curves.items() if found]


def curve_of(
    name: str, line: Line, time_ns: np.ndarray, factor: float = 1.0, held: bool = False,
    label: str = "", faint: bool = False,
) -> PlotCurve:  # fmt: skip
    """A thinned signal as a curve, in the plot's unit."""
    values = line.values if factor == 1.0 else factor * line.values
    return PlotCurve(name, time_ns, values, held, label, faint, line.overview)


def _signals(recording: Recording, spans: list[Span], fields: Sequence[str]) -> list[Line]:
    truth = recording.truth
    near = full_rate_spans(spans, truth.samples)
    thinners = {name: Thinner(truth.samples) for name in fields}
    for at, arrays in truth.pieces():
        marked = within(near, at, len(arrays["xi_m"]))
        for name, thinner in thinners.items():
            thinner.feed(at, arrays[name], marked)
    return [thinner.line() for thinner in thinners.values()]


def _measured(recording: Recording, spans: list[Span]) -> Line:
    """What was acquired, around the same contacts: a converter may be slower than the plant."""
    truth, daq = recording.truth, recording.daq
    steps = truth.step_at(np.array(spans, np.int64).reshape(-1, 2))
    own = -(-(steps - daq.first_step) // daq.every_steps)
    for position, step in daq.resumed:
        own = np.where(steps >= step, position + -(-(steps - step) // daq.every_steps), own)
    near = full_rate_spans([(max(a, 0), b) for a, b in own.tolist()], daq.samples)
    thinner = Thinner(daq.samples)
    for at, arrays in daq.pieces():
        values = daq.values_of(arrays)
        thinner.feed(at, values, within(near, at, len(values)))
    return thinner.line()


def law_states(recording: Recording, controlled: bool = True) -> list[tuple[int, str]]:
    """Time in ns and name of each state of the force law, from the controller's events; of a law
    that is not the scene's nothing is known without."""
    law = scene_value(recording, "controller", "law", "")
    end = recording.ends.get("controller")
    states: list[tuple[int, str]] = []
    for event in recording.events:
        if event.name == "controller" and event.data.kind == EventKind.LAW_MODE:
            if not states:
                states.append((0, mode_name(event.data.mode_before)))
            states.append((event.time_ns, mode_name(event.data.mode)))
    if not states and end and end.set_up.law not in ("", law):
        return [(0, "not told")]
    return states or [(0, "idle" if controlled else "off")]
