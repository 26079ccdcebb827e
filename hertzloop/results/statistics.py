"""Statistics of a run, accumulated over its time series: extremes, demand and force timing."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.metrics import truth_kernels
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.time_series import COLUMNS, F_A, F_A1, F_C, F_C1, V_P, XI_A, XI_P
from hertzloop.results.impacts import Block


class Accumulator:
    """Accumulates a result over the time series of a run, which comes in blocks."""

    def feed(self, first: int, truth: np.ndarray) -> None:
        """Add the next steps of the time series, shape (10, steps), from step `first` on."""
        raise NotImplementedError

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yield the blocks unchanged, and feed each one on its way."""
        for first, truth in blocks:
            self.feed(first, truth)
            yield first, truth


@dataclass(frozen=True)
class Extremes:
    """Largest values of a run; zero in a run without contact.

    Attributes:
        force_n: largest contact force, also within the steps, N.
        contact_s: duration of the contact with that force, s. If the run ends during that contact,
            it is at least the duration on a rigid plate.
        deflection_m: largest absolute deflection of the contact point, m.
        actuator_n: largest absolute force of the actuator, N.
        touched_s: start of the first contact, s.
    """

    force_n: float
    contact_s: float
    deflection_m: float
    actuator_n: float
    touched_s: float


class ExtremesAccumulator(Accumulator):
    """Accumulates the largest values of a run."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._touching = spec, False
        self._force_n = self._deflection_m = self._actuator_n = 0.0

    def feed(self, first: int, truth: np.ndarray) -> None:
        """Add the next steps of the time series, shape (10, steps), from step `first` on."""
        if not truth.shape[1]:
            self._touching = False
            return
        force_n, actuator_n, deflection_m = truth_kernels.extremes(
            truth[F_C],
            truth[F_C1],
            truth[F_A],
            truth[F_A1],
            truth[XI_P],
        )
        self._touching = bool(truth[F_C, -1] != 0.0)
        self._force_n = max(self._force_n, force_n)
        self._actuator_n = max(self._actuator_n, actuator_n)
        self._deflection_m = max(self._deflection_m, deflection_m)

    def result(self, impacts: Sequence[Impact]) -> Extremes:
        """Return the largest values; `impacts` are the contacts of the same run."""
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
class ActuatorDemand:
    """What a run demands of its actuator.

    Attributes:
        force_n: largest absolute force, N.
        slew_n_s: largest rate of change of the force, N/s; from step to step for a held force.
        power_w: largest absolute power, W.
        delay_s: delay of a slow command by the actuator's bandwidth, s.
    """

    force_n: float
    slew_n_s: float
    power_w: float
    delay_s: float


class ActuatorDemandAccumulator(Accumulator):
    """Accumulates the demand on an actuator. A change over missing steps does not count.

    The time series holds the velocity at the contact point. For an actuator elsewhere, the velocity
    is the mean over a step.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self._same = spec.same_point
        self._before, self._next = np.zeros((COLUMNS, 1)), 0
        self._force_n = self._change_n = self._power_w = 0.0

    def feed(self, first: int, truth: np.ndarray) -> None:
        """Add the next steps of the time series, shape (10, steps), from step `first` on."""
        if not truth.shape[1]:
            return
        before = self._before if first == self._next else truth[:, :1]
        joined = np.concatenate([before, truth], axis=1)
        force, slope, v = joined[F_A], joined[F_A1], joined[V_P]
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
            moved = np.diff(joined[XI_A]) / self.spec.step_s
            speed = 0.5 * (v[1:] + v[:-1]) if self._same else moved
            power = np.abs(force[:-1] * speed)
            change = np.abs(np.diff(force))
        self._force_n = max(self._force_n, float((np.abs(force) + np.abs(slope)).max()))
        self._change_n = max(self._change_n, float(change.max()), 2.0 * float(np.abs(slope).max()))
        self._power_w = max(self._power_w, float(power.max()))
        self._before, self._next = truth[:, -1:].copy(), first + truth.shape[1]

    def result(self) -> ActuatorDemand | None:
        """Return the demand; None if the actuator never acts."""
        if self._force_n == 0.0:
            return None
        slew_n_s = self._change_n / self.spec.step_s
        return ActuatorDemand(self._force_n, slew_n_s, self._power_w, self.spec.actuator.delay_s)


@dataclass(frozen=True)
class ForceTiming:
    """When the actuator acts, relative to the contacts.

    Attributes:
        after_touch_s: time from the first contact to the first force, s; negative if the force
            comes first, nan without a contact.
        apart: share of the absolute impulse that acts without contact.
    """

    after_touch_s: float
    apart: float


def _added(so_far: float, values: np.ndarray) -> float:
    """Add values to a sum one after the other: the bits do not depend on the block boundaries,
    which vary from run to run."""
    return float(np.add.accumulate(np.append(so_far, values))[-1])


class ForceTimingAccumulator(Accumulator):
    """Accumulates when the actuator acts, relative to the contacts."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec = spec
        self._apart = self._all = 0.0  # impulse while nothing touches, and all, in N steps
        self._touch: int | None = None
        self._push: int | None = None

    def feed(self, first: int, truth: np.ndarray) -> None:
        """Add the next steps of the time series, shape (10, steps), from step `first` on."""
        touching = truth[F_C] != 0.0
        pushed = np.abs(truth[F_A])
        if self._touch is None and touching.any():
            self._touch = first + int(np.argmax(touching))
        if self._push is None and pushed.any():
            self._push = first + int(np.argmax(pushed > 0.0))
        self._all = _added(self._all, pushed)
        self._apart = _added(self._apart, pushed[~touching])

    def result(self) -> ForceTiming | None:
        """Return the timing; None if the actuator never acts."""
        if self._push is None:
            return None
        steps = math.nan if self._touch is None else self._push - self._touch
        return ForceTiming(steps * self._spec.step_s, self._apart / self._all)
