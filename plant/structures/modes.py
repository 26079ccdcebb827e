"""Modes of anything linear, and what forces at two points can move of them."""

from dataclasses import dataclass

import numpy as np

NO_PARTICIPATION = 1e-9  # of a shape's largest value
_SAME_FREQUENCY = 1e-12  # relative; phase error of merging stays below rounding of the sums


@dataclass(frozen=True)
class Modes:
    """Modes by rising frequency, arrays (modes,): q'' + eta w q' + w^2 q = lambda (phi_c F_c +
    phi_a F_a), the contact moves by phi_c q, the actuator by phi_a q.

    `eta` is one loss factor for all, or an array; `scale_per_kg` is lambda, the inverse modal
    mass; a shape below `silent_below` is a node. A mode of frequency zero is a rigid body's.
    """

    omega: np.ndarray
    eta: float | np.ndarray
    scale_per_kg: float
    at_contact: np.ndarray
    at_actuator: np.ndarray
    silent_below: float = NO_PARTICIPATION


@dataclass(frozen=True, eq=False)
class Oscillators:
    """A structure as seen from the contact and the actuator point; all arrays (count,).

    Oscillator i obeys q'' + eta w q' + w^2 q = lambda (contact F_contact + actuator F_actuator)
    and moves the contact point by contact * q, the actuator point by actuator * q. `eta` is one
    number, or where loss factors differ one for every oscillator; `scale_per_kg`: lambda. A sensor
    elsewhere moves by sensor * q; None of one at the contact.
    """

    omega: np.ndarray
    contact: np.ndarray
    actuator: np.ndarray
    modes: int  # modes of the structure they stand for, silent ones included
    eta: float | np.ndarray
    scale_per_kg: float
    sensor: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Groups:
    """Modes of equal frequency and loss, by what forces at both points move of them.

    `starts`: the first mode of every group, (groups,). `first` and `second`: the shares of every
    mode in the vectors that the groups move along, (modes,): the first vector belongs to the
    contact, the second one to what the actuator moves apart from it. `table`: frequency (rad/s)
    and shapes at contact and actuator of every oscillator, (3, oscillators). `moved` and
    `elsewhere`: the groups that have the one and the other vector; `order` sorts these together.
    """

    starts: np.ndarray
    first: np.ndarray
    second: np.ndarray
    table: np.ndarray
    moved: np.ndarray
    elsewhere: np.ndarray
    order: np.ndarray

    @property
    def place(self) -> np.ndarray:
        """The first mode of every oscillator's group, (oscillators,)."""
        return self.starts[np.concatenate([self.moved, self.elsewhere])[self.order]]

    def shapes(self, of_modes: np.ndarray) -> np.ndarray:
        """Shapes of the oscillators from those of the modes, (modes, ...)."""
        wide = (-1, *(1,) * (of_modes.ndim - 1))
        parts = [
            np.add.reduceat(share.reshape(wide) * of_modes, self.starts)[some]
            for share, some in ((self.first, self.moved), (self.second, self.elsewhere))
        ]
        return np.asarray(np.concatenate(parts)[self.order])


def _equal(modes: Modes) -> tuple[np.ndarray, np.ndarray]:
    """The first mode of every group of equal frequency and loss, and its size, (groups,) both."""
    new = np.diff(modes.omega, prepend=-1.0) > _SAME_FREQUENCY * modes.omega
    if isinstance(modes.eta, np.ndarray):
        new |= np.diff(modes.eta, prepend=-1.0) != 0.0
    starts = np.flatnonzero(new)
    return starts, np.diff(starts, append=len(modes.omega))


def grouped(modes: Modes, same_point: bool) -> Groups:
    """Merge modes of equal frequency and loss, and drop those that neither point moves.

    A group of equal frequency sees two forces only, along the vectors of its shapes at
    the two points; an orthonormal basis of their span (one vector, or two when the
    points differ) behaves exactly as the whole group. What is merged already stays as it is, to
    the last bit.
    """
    omega, at_contact, at_actuator = modes.omega, modes.at_contact, modes.at_actuator
    starts, counts = _equal(modes)
    along = np.sqrt(np.add.reduceat(at_contact * at_contact, starts))
    moved = along > modes.silent_below
    if same_point:
        length = np.repeat(np.where(moved, along, np.inf), counts)
        places = np.flatnonzero(moved)
        table = np.stack([omega[starts], along, along])[:, moved]
        first, none = at_contact / length, places[:0]
        return Groups(
            starts, first, np.zeros_like(first), table, places, none, np.arange(len(places))
        )
    sign = np.where(at_contact[starts] < 0.0, -1.0, 1.0)
    shared = np.add.reduceat(at_actuator * at_contact, starts)
    shared = np.divide(shared, along, out=np.zeros_like(along), where=moved)
    alone = moved & (np.add.reduceat(at_contact != 0.0, starts) == 1) & (at_contact[starts] != 0.0)
    shared = np.where(alone, sign * at_actuator[starts], shared)
    share = np.divide(shared, along, out=np.zeros_like(along), where=moved)
    rest = at_actuator - np.repeat(share, counts) * at_contact
    rest[starts[alone]] = 0.0
    across = np.sqrt(np.add.reduceat(rest * rest, starts))
    elsewhere = across > modes.silent_below
    one = np.stack([omega[starts], along, shared])[:, moved]
    other = np.stack([omega[starts], np.zeros_like(across), across])[:, elsewhere]
    both = np.flatnonzero(moved), np.flatnonzero(elsewhere)
    order = np.argsort(np.concatenate(both), kind="stable")
    first, second = (
        vector / np.repeat(np.where(there, length, np.inf), counts)
        for vector, there, length in ((at_contact, moved, along), (rest, elsewhere, across))
    )
    table = np.concatenate([one, other], axis=1)[:, order]
    return Groups(starts, first, second, table, *both, order)
