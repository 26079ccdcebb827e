"""Fourth stage: whether an infinite plate may stand for the modes, and what that costs.

Until reflections return from the edges, the contact point of a thin plate is a dashpot. Image
sources say when they return; how much they matter depends on the force that the law may give, so
this stage needs the law's reach.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from controller.law import Reach
from hertzloop.scenes.errors import SceneError
from hertzloop.setup.bodies import KEPT, Bodies
from plant.contact.hertz import rigid_peak_force_n
from plant.estimates.reflections import Actuation, Reflections, reflections
from plant.schemes.registry import SCHEMES

_LONGER = 2.0  # the delay that a law may latch, against the contact without control


@dataclass(frozen=True)
class Line:
    """What the line from sensor to actuator does to the smoothness of a force: whether it is
    `smooth`, that is without steps and losses, and its latency (s)."""

    smooth: bool
    latency_s: float


def possible(bodies: Bodies, scheme: str, reach: Reach) -> bool:
    """Whether the infinite plate can stand for the modes at all: reflections are known of simply
    supported edges, and a force of more than the contact's own has no known limit."""
    bounded = reach.force_n < math.inf or reach.share <= 1.0
    supported = bodies.structure.separable is not None
    ideal = bodies.actuator.ideal and bodies.contact.limit is None
    known = SCHEMES[scheme].supports_infinite_plate and ideal and not bodies.radiating_faces
    return known and bodies.same_point and bounded and supported


@lru_cache(maxsize=KEPT)
def reflections_of(bodies: Bodies) -> Reflections:
    """When reflections return to the contact point. Raises SceneError where that is not known."""
    plate = bodies.structure.separable
    if plate is None:
        raise SceneError(f"reflections are not known for {bodies.structure}")
    return reflections(bodies.sphere, plate, bodies.contact, bodies.contact_point_m)


def error(
    bodies: Bodies, scheme: str, reach: Reach, line: Line, step_s: float, until_s: float
) -> float:
    """Error that an infinite plate is expected to have at `until_s` after the first touch, relative
    to the penetration or the plate energy; inf where that is not known."""
    if until_s <= 0.0 or not possible(bodies, scheme, reach):
        return math.inf
    found = reflections_of(bodies)
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, step_s, _actuation(bodies, reach, line, found))


def lasts_s(
    bodies: Bodies, scheme: str, reach: Reach, line: Line, step_s: float, accuracy: float
) -> float:
    """How long after the first touch an infinite plate meets the accuracy, s; zero where it does
    not do so for a whole contact."""
    if not possible(bodies, scheme, reach):
        return 0.0
    found = reflections_of(bodies)
    lasts = found.lasts_s(accuracy, step_s, _actuation(bodies, reach, line, found))
    return lasts if lasts >= found.contact_s else 0.0


def _actuation(bodies: Bodies, reach: Reach, line: Line, found: Reflections) -> Actuation:
    """What the actuator may do.

    A law that copies the contact force is as smooth as that, unless the line from sensor to
    actuator is not, with a delay of at most a contact, which it makes longer; any other counts
    as switched on and off at the largest force.
    """
    if reach.force_n < math.inf:
        return Actuation(jumps_n=2.0 * reach.force_n)
    if reach.copies and line.smooth:
        return Actuation(reach.share, _LONGER * found.contact_s + line.latency_s)
    sphere = bodies.sphere
    peak_n = rigid_peak_force_n(sphere.mass_kg, bodies.contact.stiffness, sphere.impact_speed_m_s)
    return Actuation(jumps_n=2.0 * reach.share * peak_n)
