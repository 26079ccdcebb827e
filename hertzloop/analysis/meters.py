"""Meters that follow a run's rows of truth as they come: extremes, demand, push, stability."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.analysis.impacts import F_A, F_A1, F_C, F_C1, V_P, XI_A, XI_P, Block
from hertzloop.plant.contact.hertz import GRAVITY_M_S2, rigid_contact_time_s, rigid_peak_force_n
from hertzloop.plant.figures import rows_kernels as k
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.time_series import COLUMNS
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup


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
        force_n, actuator_n, deflection_m = k.extremes(
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
            sphere, stiffness = self._spec.sphere, self._spec.contact.stiffness
            rigid_s = rigid_contact_time_s(sphere.mass_kg, stiffness, sphere.impact_speed_m_s)
            lasts_s = max(lasts_s, rigid_s)
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
        pushed = np.abs(self._setup.control_force_n(rows))
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
            self.closed = not setup.law.open_loop
        except SceneError:  # the law of a recording may not be there any more
            self.closed = True
        sphere = self.spec.sphere
        self.impact_j = sphere.mass_kg * GRAVITY_M_S2 * sphere.drop_height_m
        self._place = XI_P if self.spec.same_point else XI_A
        self._sums, self._counts = np.zeros(k.SUMS), np.zeros(k.COUNTS, np.int64)
        self._counts[k.SINCE] = -1

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        force = self.setup.control_force_n(rows)
        k.exchanged(first, force, rows[self._place], self.impact_j, self._sums, self._counts)

    def result(self) -> Stability:
        """What the rows show."""
        most_j, fed_j, largest_n = (float(self._sums[i]) for i in (k.MOST, k.FED, k.LARGEST))
        unstable = self.closed and not most_j <= UNSTABLE * self.impact_j
        pumps = self.closed and not fed_j <= self.impact_j
        sphere, contact = self.spec.sphere, self.spec.contact
        rigid_n = rigid_peak_force_n(sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s)
        since = int(self._counts[k.SINCE])
        return Stability(
            unstable=unstable,
            pumps=pumps,
            since_s=since * self.setup.step_s if since >= 0 and (unstable or pumps) else None,
            most_injected=most_j / self.impact_j,
            fed_in=fed_j / self.impact_j,
            largest_force_n=largest_n,
            of_contact=largest_n / rigid_n,
        )
