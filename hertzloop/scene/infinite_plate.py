"""An infinite plate in the place of the modes: where that is possible, and its error.

Until reflections return from the edges, the contact point of a thin plate is a dashpot. Image
sources say when they return. How much they matter depends on the force that the law may give.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from hertzloop.controller.law import ForceBound
from hertzloop.plant.contact.hertz import Contact, Sphere
from hertzloop.plant.estimates.reflections import Actuation, Reflections, looks_until_s, reflections
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.modes import Point
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.mechanics import Mechanics

_LEAST_HORIZON = -12  # power of two, 0.24 ms: most first impacts are over then
_LONGER = 2.0  # the delay that a law may latch, against the contact without control


@dataclass(frozen=True)
class InfinitePlate:
    """An infinite plate in the place of a scene's modes.

    Attributes:
        mechanics: What collides.
        scheme: Numerical scheme.
        step_s: Length of a step, s.
        accuracy: Requested relative error of the penetration.
        force_bound: Bound on the law's force.
        smooth: Whether the line from sensor to actuator neither loses a command nor makes steps in
            a force.
        latency_s: Latency of that line, s.
    """

    mechanics: Mechanics
    scheme: str
    step_s: float
    accuracy: float
    force_bound: ForceBound
    smooth: bool
    latency_s: float

    def error(self, until_s: float) -> float:
        """Return the expected error at a time after the first touch, relative to the penetration or
        the plate energy; inf where it is not known."""
        return _error(self, until_s)

    def lasts_s(self, at_most_s: float = math.inf) -> float:
        """Return how long after the first touch the plate meets the accuracy, s, or `at_most_s` if
        that is longer; zero where it does not do so for a whole contact."""
        if not self._possible:
            return 0.0
        found = reflections(*self._impact, _horizon_s(at_most_s))
        lasts = found.lasts_s(self.accuracy, self.step_s, self.actuation(found))
        return min(lasts, at_most_s) if lasts >= found.contact_s else 0.0

    def actuation(self, found: Reflections) -> Actuation:
        """Return what the actuator may do.

        A law that copies the contact force is as smooth as that, unless the line from sensor to
        actuator is not, with a delay of at most a contact, which it makes longer; any other counts
        as switched on and off at the largest force.
        """
        bound = self.force_bound
        if bound.force_n < math.inf:
            return Actuation(jumps_n=2.0 * bound.force_n)
        if bound.copies and self.smooth:
            return Actuation(bound.share, _LONGER * found.contact_s + self.latency_s)
        return Actuation(jumps_n=2.0 * bound.share * self.mechanics.rigid.peak_n)

    @property
    def _possible(self) -> bool:
        """Whether the plate can stand for the modes at all: reflections are known of simply
        supported edges, and a force of more than the contact's own has no known limit."""
        mechanics = self.mechanics
        bounded = self.force_bound.force_n < math.inf or self.force_bound.share <= 1.0
        supported = mechanics.structure.separable is not None
        ideal = mechanics.actuator.ideal and mechanics.contact.limit is None
        known = SCHEMES[self.scheme].supports_infinite_plate and ideal
        sensed = mechanics.sensor_point_m is None
        return bool(known) and sensed and mechanics.same_point and bounded and supported

    @property
    def _impact(self) -> tuple[Sphere, Plate, Contact, Point]:
        mechanics = self.mechanics
        plate = mechanics.structure.separable
        assert plate is not None  # else it would not be possible
        return mechanics.sphere, plate, mechanics.contact, mechanics.contact_point_m


def _horizon_s(until_s: float) -> float:
    """A time up to which many questions look alike: the next power of two, s."""
    if until_s == math.inf:
        return until_s
    return 2.0 ** max(math.ceil(math.log2(until_s)), _LEAST_HORIZON)


@lru_cache(maxsize=16)
def _error(plate: InfinitePlate, until_s: float) -> float:
    if until_s <= 0.0 or not plate._possible or until_s > looks_until_s(*plate._impact):
        return math.inf
    found = reflections(*plate._impact, _horizon_s(until_s))
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, plate.step_s, plate.actuation(found))
