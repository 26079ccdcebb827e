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

from hertzloop import assembly as parts
from hertzloop.results.impact_rows import F_A, XI_A, XI_P, Block
from hertzloop.scenes.scene import Scene
from plant.contact.hertz import GRAVITY_M_S2, rigid_peak_force_n

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

    def __init__(self, scene: Scene) -> None:
        self.spec, self.scene = parts.plant_spec(scene), scene
        self.closed = scene.controller.law not in _OPEN_LOOP
        sphere = self.spec.sphere
        self.impact_j = sphere.mass_kg * GRAVITY_M_S2 * sphere.drop_height_m
        self.injected_j = self.most_j = self.fed_j = self.largest_n = 0.0
        self._next = 0  # step of the next row
        self.since: int | None = None
        self._place = XI_P if self.spec.same_point else XI_A
        self._last = np.zeros((2, 0))  # force and place of the row whose work waits for the next

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        if first != self._next:
            self._last = np.zeros((2, 0))
        waiting = np.concatenate([self._last, rows[[F_A, self._place]]], axis=1)
        if not waiting.shape[1]:
            return
        start, self._next = first - self._last.shape[1], first + rows.shape[1]
        pushed, moved = waiting
        with np.errstate(over="ignore", invalid="ignore"):  # a loop that explodes
            work = pushed[:-1] * np.diff(moved)
            injected = self.injected_j + np.cumsum(work)
        if len(injected):
            self._judge(start, injected)
        self.largest_n = max(self.largest_n, float(np.max(np.abs(pushed))))
        self._last = waiting[:, -1:]

    def _judge(self, start: int, injected_j: np.ndarray) -> None:
        """Take the energy fed in until the end of every step from `start` on, J."""
        beyond = ~(np.abs(injected_j) <= self.impact_j)  # true for what is no number
        if not beyond.all():
            self.since = None
            below = int(np.flatnonzero(~beyond)[-1]) + 1
        else:
            below = 0
        if self.since is None and below < len(beyond):
            self.since = start + below
        most = float(np.max(np.abs(injected_j)))
        self.most_j = max(self.most_j, most) if np.isfinite(most) else np.inf
        self.fed_j = max(self.fed_j, float(np.max(injected_j))) if np.isfinite(most) else np.inf
        self.injected_j = float(injected_j[-1])

    def result(self) -> Stability:
        """What the rows show."""
        unstable = self.closed and not self.most_j <= UNSTABLE * self.impact_j
        pumps = self.closed and not self.fed_j <= self.impact_j
        sphere, contact = self.spec.sphere, self.spec.contact
        rigid_n = rigid_peak_force_n(sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s)
        since = self.since if unstable or pumps else None
        return Stability(
            unstable=unstable,
            pumps=pumps,
            since_s=None if since is None else since * self.scene.step_s,
            most_injected=self.most_j / self.impact_j,
            fed_in=self.fed_j / self.impact_j,
            largest_force_n=self.largest_n,
            of_contact=self.largest_n / rigid_n,
        )

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(first, rows)
            yield first, rows
