"""An infinite plate in the place of the modes: where that is possible, and its error.

Until reflections return from the edges, the contact point of a thin plate is a dashpot. How much
they matter depends on the force that the law may give.
"""

import math
from dataclasses import dataclass
from functools import cached_property

from hertzloop.controller.law import ForceBound
from hertzloop.plant.estimates import criteria
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.mechanics import Mechanics

_HALVINGS = 30  # of a second: to a nanosecond
_LONGER = 2.0  # the delay that a law may latch, against the contact without control
# Of the error of order 4 by the step; contact damping and switched forces need the most.
_STEP_FACTOR = 3.0


@dataclass(frozen=True)
class InfinitePlate:
    """An infinite plate in the place of a scene's modes.

    Attributes:
        mechanics: What collides.
        scheme: Numerical scheme.
        step_s: Length of a step, s.
        accuracy: Requested relative error of the penetration.
        force_bound: Bound on the law's force.
        smooth: Whether sensor and signal path neither lose a command nor makes steps in
            a force.
        latency_s: Latency of the signal path, s.
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
        the plate energy; inf where it is not known: without a simply supported plate, or before a
        contact is over."""
        if self._plate is None or until_s < self._contact_s:
            return math.inf
        return self._error(until_s)

    def lasts_s(self, at_most_s: float = math.inf) -> float:
        """Return how long after the first touch the plate meets the accuracy, s, or `at_most_s` if
        that is shorter; zero where it does not do so for a whole contact."""
        if self._plate is None:
            return 0.0
        if self._contact_s <= at_most_s < math.inf and self._error(at_most_s) <= self.accuracy:
            return at_most_s
        return min(self._lasts_s, at_most_s) if self._lasts_s >= self._contact_s else 0.0

    @cached_property
    def _lasts_s(self) -> float:
        low, high = 0.0, 1.0
        if self._plate is None:
            return low
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self._error(middle) <= self.accuracy:
                low = middle
            else:
                high = middle
        return low

    def _error(self, until_s: float) -> float:
        """Error by the reflections and by the step, which in the gap goes on growing after the
        contact with the error of the speed."""
        bound, rigid = self.force_bound, self.mechanics.rigid
        contacts = max(until_s / rigid.contact_s, 1.0)
        by_step = _STEP_FACTOR * (self.step_s / rigid.contact_s) ** 4 * contacts
        first_return_s, number = self._first_return_s, self._inelasticity
        late = until_s / first_return_s
        # A law that copies the contact force is as smooth as that, with a delay of at most a
        # contact, which it makes longer, unless sensor or signal path is not.
        if bound.force_n == math.inf and bound.copies and self.smooth:
            delay_s = min(until_s, _LONGER * self._contact_s + self.latency_s)
            late_copy = (delay_s + self._contact_s) / first_return_s
            return by_step + criteria.reflections_error(late, number, bound.share, late_copy)
        share = min(bound.share, bound.force_n / rigid.peak_n)
        switched = criteria.switched_error(late, number, share, contacts)
        return by_step + criteria.reflections_error(late, number, 0.0, 0.0) + switched

    @cached_property
    def _first_return_s(self) -> float:
        assert self._plate is not None
        point_m, contact_s = self.mechanics.contact_point_m, self.mechanics.rigid.contact_s
        return criteria.first_return_s(self._plate, self._plate.size_m, point_m, contact_s)

    @cached_property
    def _plate(self) -> Plate | None:
        """The plate, if an infinite one can stand for it at all: errors are known of simply
        supported edges, and a force of more than the contact's own has no known limit."""
        mechanics = self.mechanics
        bounded = self.force_bound.force_n < math.inf or self.force_bound.share <= 1.0
        ideal = mechanics.actuator.ideal and mechanics.contact.limit is None
        known = SCHEMES[self.scheme].accepts("run.plate_model", "infinite") and ideal
        at_contact = mechanics.sensor_point_m is None and mechanics.same_point
        return mechanics.structure.simply_supported if known and at_contact and bounded else None

    @cached_property
    def _inelasticity(self) -> float:
        mechanics = self.mechanics
        return criteria.zener_inelasticity(
            mechanics.sphere, mechanics.local_plate, mechanics.contact
        )

    @cached_property
    def _contact_s(self) -> float:
        return criteria.zener_contact_s(self._inelasticity, self.mechanics.rigid.contact_s)
