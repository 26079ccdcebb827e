"""What a run asks of its actuator: force, slew and power, from its rows of truth."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hertzloop.results.impact_rows import F_A, F_A1, V_P, XI_A, Block
from plant.plant import PlantSpec
from plant.time_series import COLUMNS


@dataclass(frozen=True)
class Demand:
    """Largest force (N), change of it (N/s; of a force held over steps, from step to step) and
    power (W), each without its sign; by how much its bandwidth delays a slow command (s)."""

    force_n: float
    slew_n_s: float
    power_w: float
    delay_s: float


class DemandMeter:
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

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(first, rows)
            yield first, rows

    def result(self) -> Demand | None:
        """What the rows show; None where the actuator never pushes."""
        if self._force_n == 0.0:
            return None
        slew_n_s = self._change_n / self.spec.step_s
        return Demand(self._force_n, slew_n_s, self._power_w, self.spec.actuator.delay_s)
