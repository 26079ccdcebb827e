"""Whether a closed loop is stable, by the energy that its actuator feeds in.

Plate, contact and gravity hold no more energy than the sphere brought, and what is fed in. A law
that copies or opposes what it senses exchanges about that energy at most (0.9 times in all
shipped scenes, 4.2 times with every kappa up to 2); where it goes on feeding in what it has
fed in itself, no multiple is the last. Runs of 20 000 to 60 000 steps that leave the bound are
beyond a thousandfold.

A loop that has put in more than the sphere brought pumps, bounded or not: plate and sphere then
hold energy that no impact could have given them.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hertzloop.results.impact_rows import F_A, XI_A, XI_P, Block
from hertzloop.setup import Setup
from plant.contact.hertz import GRAVITY_M_S2, rigid_peak_force_n
from plant.figures import rows_kernels as k

UNSTABLE = 10.0  # times the energy of the impact
# Their forces are known before the run: nothing is fed back, whatever energy they feed in.
_OPEN_LOOP = ("off", "constant", "profile", "precomputed")


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


class StabilityMeter:
    """Follows the work of the actuator over rows of truth that come in blocks; over steps that
    are missing, none is done."""

    def __init__(self, setup: Setup) -> None:
        self.spec, self.setup = setup.plant, setup
        self.closed = setup.law_reference not in _OPEN_LOOP
        sphere = self.spec.sphere
        self.impact_j = sphere.mass_kg * GRAVITY_M_S2 * sphere.drop_height_m
        self._place = XI_P if self.spec.same_point else XI_A
        self._sums, self._counts = np.zeros(k.SUMS), np.zeros(k.COUNTS, np.int64)
        self._counts[k.SINCE] = -1

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        k.exchanged(first, rows[F_A], rows[self._place], self.impact_j, self._sums, self._counts)

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

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(first, rows)
            yield first, rows
