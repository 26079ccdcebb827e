"""The largest values of a run, from its rows of truth as they come: what it leaves out follows."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.results.impact_rows import F_A, F_A1, F_C, F_C1, XI_P, Block
from plant.contact.hertz import rigid_contact_time_s
from plant.figures import rows_kernels as k
from plant.figures.impacts import Impact
from plant.plant import PlantSpec


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


class ExtremesMeter:
    """Follows rows of truth that come in blocks."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._touching = spec, False
        self._force_n = self._deflection_m = self._actuator_n = 0.0

    def feed(self, rows: np.ndarray) -> None:
        """Take rows, shape (10, steps)."""
        if not rows.shape[1]:
            self._touching = False
            return
        self._force_n = max(self._force_n, k.largest_sum(rows[F_C], rows[F_C1]))
        self._actuator_n = max(self._actuator_n, k.largest_sum(rows[F_A], rows[F_A1]))
        self._touching = bool(rows[F_C, -1] != 0.0)
        self._deflection_m = max(self._deflection_m, k.largest(rows[XI_P]))

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(rows)
            yield first, rows

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
