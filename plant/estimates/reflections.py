"""How long an infinite plate does: an a-priori estimate of what the reflections change.

A simply supported plate is an infinite one with image sources: in every edge the point's mirror
image with the opposite sign. A unit impulse on an infinite plate displaces a point at the
distance r by (1 - (2/pi) Si(u))/Z after the time t, u = r^2/(4 a t), a = sqrt(B'/m''),
Z = 8 sqrt(B' m'') (Morse and Ingard 1968). Its frequency w arrives with the group speed
2 sqrt(a w), so there is no first moment, but the smooth force of a contact holds little of the high
frequencies that come early.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.hertz import Contact, Sphere, rigid_impact
from hertzloop.plant.estimates.reflections_kernels import add_twice_integrated
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant, impedance_n_s_m
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.time_series import V_P, XI, series_under

_STEPS_PER_CONTACT = 32  # of a contact on a rigid plate
_STEPS = 1024  # at most; the estimate does not look further
_FARTHEST = 4.0  # images within so many times the nearest one's distance count
_LATE = 2.0  # u of the nearest image until which those are enough
_EARLY = 1e3  # u beyond which an image is silent: its part falls as u^-3
# Errors of 119 whole contacts without control, on 90 random scenes as in benchmarks/model_order.py,
# were up to 1.44 times the estimate without it, in the median 0.8.
_FACTOR = 1.5
_STEP_FACTOR = 3.0  # of the order-4 error; contact damping and switched forces need the most


class Actuation(NamedTuple):
    """What an actuator may do: push with `smooth` times the contact force delayed by up to
    `delay_s` (s), and switch forces on and off, `jumps_n` in all (N)."""

    smooth: float = 0.0
    delay_s: float = 0.0
    jumps_n: float = 0.0


_NONE = Actuation()


@dataclass(frozen=True, eq=False)
class Reflections:
    """What leaving out the reflections costs from the first touch on, at `times_s`, rising.

    Without control: `gap` relative to its largest value in contact, `energy` of the plate relative
    to itself, `copy`: work that the contact force would do on the reflected wave if delayed by
    up to `times_s`, relative to the plate energy, `way`: length of the way that the wave
    moves the point, per plate energy (m/J). By 1 N switched on at the first touch:
    `step_gap`, as `gap`, and `step_energy`, its reflected work per plate energy. Shapes
    (times,), none falling. `contact_s`: length of the contact, inf if it is not over by then;
    `rigid_s`: on a rigid plate.
    """

    times_s: np.ndarray
    gap: np.ndarray
    energy: np.ndarray
    copy: np.ndarray
    way: np.ndarray
    step_gap: np.ndarray
    step_energy: np.ndarray
    contact_s: float
    rigid_s: float

    def error(self, until_s: float, step_s: float, actuation: Actuation = _NONE) -> float:
        """Expected error of a run that ends `until_s` after the first touch, the largest of gap,
        rebound speed and plate energy; inf beyond what was looked at."""
        at = int(np.searchsorted(self.times_s, until_s))
        if at == len(self.times_s):
            return math.inf
        return float(self.errors(step_s, actuation)[at])

    def lasts_s(self, accuracy: float, step_s: float, actuation: Actuation = _NONE) -> float:
        """How long after the first touch the expected error stays within `accuracy`, s."""
        return _lasts_s(self, accuracy, step_s, actuation)

    def errors(self, step_s: float, actuation: Actuation) -> np.ndarray:
        """Errors at all times.

        A force that is switched counts as if in the worst moment. The step's own error is of
        order 4; in the gap it goes on growing after the contact with the error of the speed.
        """
        share, delay_s, jumps = actuation
        delayed = np.searchsorted(self.times_s, np.minimum(self.times_s, delay_s))
        gap = (1.0 + share) * self.gap + jumps * self.step_gap
        energy = self.energy + share * (1.0 + share) * self.copy[delayed]
        # Two jumps make a force.
        energy += 0.5 * jumps * (self.way + 0.5 * jumps * self.step_energy)
        lasts = np.maximum(self.times_s / self.rigid_s, 1.0)
        by_step = _STEP_FACTOR * (step_s / self.rigid_s) ** 4 * lasts
        return np.asarray(_FACTOR * np.maximum(gap, energy) + by_step)


@lru_cache(maxsize=512)
def _lasts_s(of: Reflections, accuracy: float, step_s: float, actuation: Actuation) -> float:
    within = of.errors(step_s, actuation) <= accuracy
    return float(of.times_s[within][-1]) if within.any() else 0.0


@lru_cache(maxsize=16)
def images(
    size_m: tuple[float, float], point_m: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances (m^2) and signs of the nearer mirror images of a point of a plate."""
    along = []
    for x, length in zip(point_m, size_m, strict=True):
        turns = 2.0 * length * np.arange(-3, 4)
        along.append((np.concatenate([turns, turns - 2.0 * x]), np.repeat([1.0, -1.0], 7)))
    (dx, sx), (dy, sy) = along
    squared = np.add.outer(dx * dx, dy * dy).ravel()
    signs = np.outer(sx, sy).ravel()
    nearest = squared[squared > 0.0].min()
    kept = (squared > 0.0) & (squared <= _FARTHEST**2 * nearest)
    return squared[kept], signs[kept]


def _far(
    sphere: Sphere, plate: Plate, contact: Contact, point_m: tuple[float, float]
) -> tuple[np.ndarray, float, int]:
    """r^2/(4 a) of the images, s; the step of the estimate, s; how many it has at most."""
    rigid_s = rigid_impact(sphere, contact).contact_s
    a = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    r4a = images(plate.size_m, point_m)[0] / (4.0 * a)
    h = rigid_s / _STEPS_PER_CONTACT
    return r4a, h, min(_STEPS, int(r4a.min() / (_LATE * h)))


def looks_until_s(
    sphere: Sphere, plate: Plate, contact: Contact, point_m: tuple[float, float]
) -> float:
    """How long after the first touch the estimate ends, s; beyond, the error is unknown."""
    _, h, steps = _far(sphere, plate, contact, point_m)
    return h * steps if steps > 1 else 0.0


@lru_cache(maxsize=64)
def reflections(
    sphere: Sphere,
    plate: Plate,
    contact: Contact,
    point_m: tuple[float, float],
    until_s: float = math.inf,
) -> Reflections:
    """The estimate for an impact: the images of the force that it has on an infinite plate.

    It looks as far as it takes to know the error until the contact ends, and until `until_s` after
    the first touch.

    To first order: that the contact answers to the reflections is in the factor. Damping of the
    plate, which only weakens reflections, is left out.
    """
    r4a, h, steps = _far(sphere, plate, contact, point_m)
    signs, rigid_s = images(plate.size_m, point_m)[1], _STEPS_PER_CONTACT * h
    if steps < 2:
        return Reflections(*(np.zeros(0),) * 7, math.inf, rigid_s)
    spec = PlantSpec(sphere, plate, contact, point_m, point_m, h, 0.5 / h, 0.0, infinite_plate=True)
    free = series_under(ModalPlant(spec), np.zeros(steps + 1))[:, 1:]
    z = impedance_n_s_m(plate)
    force, gap = z * free[V_P], free[XI]
    left = int(np.argmax(gap > 0.0)) if gap.max() > 0.0 else steps
    touching = int(np.flatnonzero(force)[-1]) + 1  # steps; most come after the contact
    # A delayed force meets waves that come as much later as it lasts.
    steps = min(steps, math.ceil(min(max(h * (left + 1), until_s) / h, steps)) + 1 + touching)
    force, gap = force[:steps], gap[:steps]
    t = h * np.arange(1, steps + 1)
    once, twice = np.zeros(steps), np.zeros(steps)
    weights: dict[float, float] = {}  # in the middle most are alike
    for ratio, sign in zip(r4a.tolist(), signs.tolist(), strict=True):
        weights[ratio] = weights.get(ratio, 0.0) + sign
    for ratio, weight in weights.items():
        heard = int(np.searchsorted(t, ratio / _EARLY, "right"))
        add_twice_integrated(t[heard:], ratio, weight, once[heard:], twice[heard:])
    slopes = np.diff(force, prepend=0.0) / h  # of a force linear between the steps
    bends = np.diff(slopes, prepend=0.0)
    shift = (
        np.convolve(bends[: touching + 2], twice)[:steps] / z
    )  # of the plate by the reflections, m
    work = np.cumsum(force * np.diff(shift, prepend=0.0))
    energy = float(np.sum(force * force)) * h / z
    depth = -gap.min()
    moved = np.diff(shift, prepend=0.0)

    def rising(values: np.ndarray) -> np.ndarray:
        return np.maximum.accumulate(abs(values))

    return Reflections(
        times_s=t,
        gap=rising(shift) / depth,
        energy=rising(work) / energy,
        copy=rising(np.correlate(moved, force[:touching], "full")[touching - 1 :]) / energy,
        way=np.cumsum(abs(moved)) / energy,
        step_gap=rising(once) / (z * depth),
        step_energy=rising(once) / (z * energy),
        contact_s=float(t[left]) if left < steps else math.inf,
        rigid_s=rigid_s,
    )
