"""Meters that follow a run's rows of truth as they come: extremes, demand, push, stability."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from hertzloop.analysis.impacts import PIECE, Block, RowsOfImpact
from hertzloop.plant.actuator import rest_force_n
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.figures import rows_kernels as rows_k
from hertzloop.plant.figures.impacts import Impact, work_j
from hertzloop.plant.figures.noise import (
    RADIATED_UP_TO_HZ,
    ImpactNoise,
    audible,
    audible_alone,
    impact_noise,
    modal_drive,
)
from hertzloop.plant.plant import PlantSpec, modes_of
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import COLUMNS, F_A, F_A1, F_C, F_C1, V_P, XI_A, XI_P
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup
from hertzloop.setup.controller import loaded_law


def control_force_n(setup: Setup, rows: np.ndarray) -> np.ndarray:
    """Return the actuator's force beyond that without a command, N, of rows of a time series,
    shape (10, steps)."""
    rest_n = rest_force_n(setup.actuator, setup.step_s)
    return np.asarray(rows[F_A] - rest_n if rest_n else rows[F_A])


class Meter:
    """Follows rows of truth that come in blocks."""

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        raise NotImplementedError

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(first, rows)
            yield first, rows


@dataclass(frozen=True)
class Extremes:
    """Largest contact force (N, within the steps), length of the contact in which it was (s; of
    one that the run's end cuts off at least that on a rigid plate), largest deflection of the
    struck point (m) and force of the actuator (N), both without sign; `touched_s`: start of the
    first contact. Zero in a run without contact."""

    force_n: float
    contact_s: float
    deflection_m: float
    actuator_n: float
    touched_s: float


class ExtremesMeter(Meter):
    """Follows rows of truth that come in blocks."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._touching = spec, False
        self._force_n = self._deflection_m = self._actuator_n = 0.0

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        if not rows.shape[1]:
            self._touching = False
            return
        force_n, actuator_n, deflection_m = rows_k.extremes(
            rows[F_C], rows[F_C1], rows[F_A], rows[F_A1], rows[XI_P]
        )
        self._touching = bool(rows[F_C, -1] != 0.0)
        self._force_n = max(self._force_n, force_n)
        self._actuator_n = max(self._actuator_n, actuator_n)
        self._deflection_m = max(self._deflection_m, deflection_m)

    def result(self, impacts: Sequence[Impact]) -> Extremes:
        """What the rows show; `impacts` are those found in them."""
        hardest = max(impacts, key=lambda impact: impact.peak_force_n, default=None)
        lasts_s = 0.0 if hardest is None else hardest.duration_s
        if self._touching and hardest is not None and hardest is impacts[-1]:
            lasts_s = max(lasts_s, rigid_impact(self._spec.sphere, self._spec.contact).contact_s)
        return Extremes(
            self._force_n,
            lasts_s,
            self._deflection_m,
            self._actuator_n,
            impacts[0].start_s if impacts else 0.0,
        )


@dataclass(frozen=True)
class Demand:
    """Largest force (N), change of it (N/s; of a force held over steps, from step to step) and
    power (W), each without its sign; by how much its bandwidth delays a slow command (s)."""

    force_n: float
    slew_n_s: float
    power_w: float
    delay_s: float


class DemandMeter(Meter):
    """Follows an actuator over rows of truth that come in blocks; what changes over steps that
    are missing is not counted.

    The velocity at the struck point is in the rows; elsewhere it is the mean over a step.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self._same = spec.same_point
        self._before, self._next = np.zeros((COLUMNS, 1)), 0
        self._force_n = self._change_n = self._power_w = 0.0

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        if not rows.shape[1]:
            return
        before = self._before if first == self._next else rows[:, :1]
        joined = np.concatenate([before, rows], axis=1)
        force, slope, v = joined[F_A], joined[F_A1], joined[V_P]
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
            moved = np.diff(joined[XI_A]) / self.spec.step_s
            speed = 0.5 * (v[1:] + v[:-1]) if self._same else moved
            power = np.abs(force[:-1] * speed)
            change = np.abs(np.diff(force))
        self._force_n = max(self._force_n, float((np.abs(force) + np.abs(slope)).max()))
        self._change_n = max(self._change_n, float(change.max()), 2.0 * float(np.abs(slope).max()))
        self._power_w = max(self._power_w, float(power.max()))
        self._before, self._next = rows[:, -1:].copy(), first + rows.shape[1]

    def result(self) -> Demand | None:
        """What the rows show; None where the actuator never pushes."""
        if self._force_n == 0.0:
            return None
        slew_n_s = self._change_n / self.spec.step_s
        return Demand(self._force_n, slew_n_s, self._power_w, self.spec.actuator.delay_s)


@dataclass(frozen=True)
class Push:
    """From the first contact to the first force, s (negative: before; nan without a contact), and
    the share of the push while nothing touches."""

    after_touch_s: float
    apart: float


def _added(so_far: float, values: np.ndarray) -> float:
    """A sum with these values, one after the other: the same bits however the rows are cut into
    blocks, which the clock decides while a run is recorded."""
    return float(np.add.accumulate(np.append(so_far, values))[-1])


class PushMeter(Meter):
    """When an actuator pushes, against the contacts, over rows of truth that come in blocks."""

    def __init__(self, setup: Setup) -> None:
        self._setup, self._step_s = setup, setup.step_s
        self._apart = self._all = 0.0  # impulse while nothing touches, and all, in N steps
        self._touch: int | None = None
        self._push: int | None = None

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        touching = rows[F_C] != 0.0
        pushed = np.abs(control_force_n(self._setup, rows))
        if self._touch is None and touching.any():
            self._touch = first + int(np.argmax(touching))
        if self._push is None and pushed.any():
            self._push = first + int(np.argmax(pushed > 0.0))
        self._all = _added(self._all, pushed)
        self._apart = _added(self._apart, pushed[~touching])

    def result(self) -> Push | None:
        """What the rows show; None where the actuator never pushes."""
        if self._push is None:
            return None
        steps = math.nan if self._touch is None else self._push - self._touch
        return Push(steps * self._step_s, self._apart / self._all)


# Plate, contact and gravity hold no more energy than the sphere brought, and what is fed in. A law
# that copies or opposes what it senses exchanges about that energy at most (0.9 times in all
# shipped scenes, 4.2 times with every kappa up to 2); where it goes on feeding in what it has fed
# in itself, no multiple is the last. Runs of 20 000 to 60 000 steps that leave the bound are beyond
# a thousandfold. A loop that has put in more than the sphere brought pumps, bounded or not: plate
# and sphere then hold energy that no impact could have given them.
UNSTABLE = 10.0  # times the energy of the impact


@dataclass(frozen=True)
class Stability:
    """`unstable`: the actuator fed in, or took, more than UNSTABLE times the energy of the impact,
    `most_injected` at a time; `pumps`: it fed in, in sum, more than that energy itself, `fed_in` at
    most; `since_s`: from when on what it exchanged was more than that energy, None where neither is
    so, or it is not so at the end. `largest_force_n`: the actuator's, `of_contact` in units of the
    largest that the impact could cause on a rigid plate. Laws that know their forces ahead are
    never unstable, and do not pump."""

    unstable: bool
    pumps: bool
    since_s: float | None
    most_injected: float
    fed_in: float
    largest_force_n: float
    of_contact: float


class StabilityMeter(Meter):
    """Follows the work of the actuator over rows of truth that come in blocks; over steps that
    are missing, none is done."""

    def __init__(self, setup: Setup) -> None:
        self.spec, self.setup = setup.plant, setup
        try:  # without feedback a law may feed in any energy
            self.closed = not loaded_law(setup).open_loop
        except SceneError:  # the law of a recording may not be there any more
            self.closed = True
        sphere = self.spec.sphere
        self.impact_j = sphere.mass_kg * GRAVITY_M_S2 * sphere.drop_height_m
        self._place = XI_P if self.spec.same_point else XI_A
        self._sums, self._counts = np.zeros(rows_k.SUMS), np.zeros(rows_k.COUNTS, np.int64)
        self._counts[rows_k.SINCE] = -1

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        force = control_force_n(self.setup, rows)
        rows_k.exchanged(first, force, rows[self._place], self.impact_j, self._sums, self._counts)

    def result(self) -> Stability:
        """What the rows show."""
        most_j, fed_j, largest_n = (
            float(self._sums[i]) for i in (rows_k.MOST, rows_k.FED, rows_k.LARGEST)
        )
        unstable = self.closed and not most_j <= UNSTABLE * self.impact_j
        pumps = self.closed and not fed_j <= self.impact_j
        rigid_n = rigid_impact(self.spec.sphere, self.spec.contact).peak_n
        since = int(self._counts[rows_k.SINCE])
        return Stability(
            unstable=unstable,
            pumps=pumps,
            since_s=since * self.setup.step_s if since >= 0 and (unstable or pumps) else None,
            most_injected=most_j / self.impact_j,
            fed_in=fed_j / self.impact_j,
            largest_force_n=largest_n,
            of_contact=largest_n / rigid_n,
        )


# Of 20 kHz: no oscillator stands for modes further apart than that.
_BEYOND_AUDIBLE = 1.01
_APART = 1 << 10  # steps without force between two parts of a force's spectrum


# A figure is one row: tables, pictures, JSON, files and the reference page are made of it.
Kind = TypeVar("Kind", bound=type)


@dataclass(frozen=True)
class FigureRow:
    """A figure.

    Attributes:
        meaning: what it is, with its unit.
        words: heading in tables and pictures, without unit; "" where it has none.
        unit: the unit there.
        factor: from the value to that unit.
        db: factor of the logarithm of its ratio in dB, 0 of one that is compared in per cent.
        of: what makes the value of what the figures are taken from, or the path of an attribute.
        shown: whether the command and the report show it without being asked.
        without: the value without control.
    """

    meaning: str
    words: str = ""
    unit: str = ""
    factor: float = 1.0
    db: float = 0.0
    of: Callable[[Any], Any] | str = ""
    shown: bool = False
    without: float = 0.0


def figure(*about: Any, **more: Any) -> Any:
    """A field of a dataclass of figures; arguments as in `FigureRow`."""
    return field(metadata={"figure": FigureRow(*about, **more)})


def rows_of(kind: type) -> dict[str, FigureRow]:
    """The figures of a dataclass by name."""
    return {one.name: one.metadata["figure"] for one in fields(kind)}


def described(kind: Kind) -> Kind:
    """A dataclass of figures whose docstring says what each is."""
    told = (f"        {name}: {row.meaning}." for name, row in rows_of(kind).items())
    kind.__doc__ = f"{kind.__doc__}\n    Attributes:\n" + "\n".join(told) + "\n    "
    return kind


@described
@dataclass(frozen=True)
class SpanFigures:
    """Figures of the first impact, or of the whole run.

    `plant.figures.rows_kernels` defines the first impact. The whole run lasts from the first touch
    to its end. Radiated energies are nan unless the structure is a simply supported plate.
    """

    # fmt: off
    contacts: int = figure("number of contacts", "contacts")
    contact_time_s: float = figure("duration of the first contact, s",
                                   "contact time, first contact", "us", 1e6)
    impact_speed_m_s: float = figure("speed of the striker before the first contact, m/s",
                                     "impact speed", "m/s")
    rebound_speed_m_s: float = figure("speed of the striker after the last contact, m/s",
                                      "rebound speed", "m/s")
    rebound_height_m: float = figure("height of a sphere after the last contact, by energy, m",
                                     "rebound height", "mm", 1e3)
    peak_force_n: float = figure("largest contact force, N", "peak force", "N", db=20.0)
    plate_energy_j: float = figure("work of contact force and actuator force on the plate, J",
                                   "plate energy", "uJ", 1e6, db=10.0)
    plate_speed_max_m_s: float = figure("largest plate speed at the contact point, m/s",
                                        "largest plate speed", "m/s", db=20.0)
    radiated_j: float = figure("figure of the study, sum of sigma E up to 20 kHz, J",
                               "sigma E to 20 kHz, eq. 3.12 (study)", "uJ", 1e6, db=10.0)
    sound_j: float = figure("energy that the plate radiates up to 20 kHz, J",
                            "radiated to 20 kHz, eq. 3.12", "uJ", 1e6, db=10.0)
    longhorn_j: float = figure("acceleration noise energy (Longhorn 1952), J",
                               "acceleration noise, Longhorn", "uJ", 1e6, db=10.0)
    holmes_j: float = figure("acceleration noise energy (Holmes 1974), J",
                             "acceleration noise, Holmes", "uJ", 1e6, db=10.0)
    peak_pressure_pa: float = figure("bound of the sound pressure at 1 m, Pa",
                                     "peak pressure bound at 1 m", "Pa", db=20.0)
    # fmt: on


@dataclass(frozen=True)
class RunFigures:
    """Figures of a run.

    Attributes:
        first_impact: figures of the first impact; None without a contact.
        whole_run: figures of all contacts; None without a contact and for the published scheme.
    """

    first_impact: SpanFigures | None
    whole_run: SpanFigures | None


MUCH_DB = 0.5  # between the change in the first impact and that over all contacts
SPAN_ROWS = rows_of(SpanFigures)
# Factor of the logarithm of a ratio: of energies, and of amplitudes.
DECIBELS = {name: row.db for name, row in SPAN_ROWS.items() if row.db}
_SHARED = {f.name for f in fields(ImpactNoise)} & {*SPAN_ROWS}


def of_impact(found: RowsOfImpact) -> SpanFigures:
    """Figures of one impact."""
    return _figures(1, found.impact.peak_force_n, found.noise)


def _figures(contacts: int, peak_force_n: float, noise: ImpactNoise) -> SpanFigures:
    return SpanFigures(
        contacts=contacts,
        rebound_speed_m_s=noise.next_impact_speed_m_s,
        peak_force_n=peak_force_n,
        plate_energy_j=noise.transmitted_j,
        **{name: value for name, value in vars(noise).items() if name in _SHARED},
    )


def decibels(value: float, reference: float, factor: float = 10.0) -> float:
    """`factor` times lg of a ratio; nan where it has no logarithm."""
    ratio = value / reference if reference else math.nan
    return factor * math.log10(ratio) if ratio > 0.0 else math.nan


def changes_db(value: SpanFigures, reference: SpanFigures) -> dict[str, float]:
    """By how many dB energies (10 lg) and amplitudes (20 lg) differ, by the figures' names."""
    ours, theirs = vars(value), vars(reference)
    return {name: decibels(ours[name], theirs[name], by) for name, by in DECIBELS.items()}


@lru_cache(maxsize=8)
def audible_modes(spec: PlantSpec) -> Oscillators:
    """Oscillators up to 20 kHz. An infinite plate has no use for others, which are not looked for
    where two are that low."""
    beyond_hz = _BEYOND_AUDIBLE * RADIATED_UP_TO_HZ
    if spec.infinite_plate and spec.frequency_limit_hz > beyond_hz:
        with suppress(ValueError):  # none is so low
            low = modes_of(replace(spec, frequency_limit_hz=beyond_hz))
            if audible(low) > 1:
                return audible_alone(low)
    return audible_alone(modes_of(spec))


class WholeRunMeter(Meter):
    """Follows a run of a consistent scheme from its first touch on, over rows of truth that come
    in blocks. It sums over pieces that are counted from there."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._modes = spec, audible_modes(spec)
        self._parts: list[np.ndarray] = []
        self._before = np.zeros((10, 0))
        self._held = self._done = 0
        self._touched = False
        self._work_j = self._speed_max = 0.0
        self._drive: np.ndarray | float = 0.0

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        if not self._touched:
            touching = np.flatnonzero(rows[F_C])
            self._touched = bool(len(touching))
            start = int(touching[0]) if self._touched else rows.shape[1]
            if start:
                self._before = rows[:, start - 1 : start].copy()
            rows = rows[:, start:]
        if not rows.shape[1]:
            return
        self._parts.append(rows)
        self._held += rows.shape[1]
        while self._held > PIECE:
            rows = np.concatenate(self._parts, axis=1)
            self._take(rows[:, :PIECE], rows[:, PIECE : PIECE + 1])
            self._parts, self._held = [rows[:, PIECE:]], rows.shape[1] - PIECE

    def result(self, impacts: list[Impact]) -> SpanFigures | None:
        """Figures of the run, whose impacts are known; None without any."""
        if self._parts:
            self._take(np.concatenate(self._parts, axis=1), np.zeros((10, 0)))
            self._parts = []
        if not impacts:
            return None
        noise = impact_noise(
            self._spec, self._modes, np.asarray(self._drive), self._work_j, self._speed_max,
            impacts[0].duration_s, impacts[0].impact_speed_m_s, impacts[-1].rebound_speed_m_s,
        )  # fmt: skip
        return _figures(len(impacts), max(i.peak_force_n for i in impacts), noise)

    def _take(self, piece: np.ndarray, following: np.ndarray) -> None:
        spec, lead = self._spec, self._before.shape[1]
        rows = np.concatenate([self._before, piece, following], axis=1)
        self._work_j += work_j(spec, rows, lead)
        self._speed_max = max(self._speed_max, float(np.abs(piece[V_P]).max(initial=0.0)))
        pushed = np.flatnonzero((piece[F_C] != 0.0) | (piece[F_A] != 0.0))
        for some in np.split(pushed, np.flatnonzero(np.diff(pushed) > _APART) + 1):
            if not len(some):
                continue
            own = piece[:, some[0] : some[-1] + 1]
            self._drive = self._drive + modal_drive(
                self._modes, -own[F_C], own[F_A], spec.step_s, -own[F_C1],
                self._done + int(some[0]), own[F_A1],
            )  # fmt: skip
        self._before = piece[:, -1:].copy()
        self._done += piece.shape[1]


def change_db(
    value: float,
    reference: float,
    factor: float = 10.0,
    error: float = 0.0,
    reference_error: float = 0.0,
) -> tuple[float, float]:
    """A ratio in dB, nan where there is none, and its error by those of both numbers."""
    change = decibels(value, reference, factor)
    if math.isnan(change):
        return math.nan, math.nan
    wrong = error / abs(value) + reference_error / abs(reference)
    return change, factor / math.log(10.0) * wrong


@dataclass(frozen=True)
class Difference:
    """One figure of two runs.

    Attributes:
        span: "first impact" or "whole run".
        figure: name of the figure in `SpanFigures`.
        a: value of the first run, SI units.
        b: value of the second run, SI units.
        b_to_a: change from a to b in `unit`; nan where no ratio is defined.
        unit: "dB" for energies and amplitudes, "%" for other quantities, "" for a count.
    """

    span: str
    figure: str
    a: float
    b: float
    b_to_a: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """All figures of two runs.

    Attributes:
        rows: the figures of the first impact, then those of the whole run.
    """

    rows: tuple[Difference, ...]


def compared(a: RunFigures, b: RunFigures) -> Comparison:
    """Compare the spans that both runs have."""
    return Comparison(tuple(_rows(a, b)))


def _rows(a: RunFigures, b: RunFigures) -> Iterator[Difference]:
    for span in (f.name for f in fields(RunFigures)):
        one, other = getattr(a, span), getattr(b, span)
        if one is None or other is None:
            continue
        for name in SPAN_ROWS:
            yield _difference(span, name, getattr(one, name), getattr(other, name))


def _difference(span: str, name: str, a: float, b: float) -> Difference:
    if name in DECIBELS:
        return Difference(span, name, a, b, decibels(b, a, DECIBELS[name]), "dB")
    if name == "contacts":
        return Difference(span, name, a, b, b - a, "")
    change = 100.0 * (b / a - 1.0) if a else float("nan")
    return Difference(span, name, a, b, change, "%")
