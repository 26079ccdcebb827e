"""An infinite plate in the place of the modes: where that is possible, and its error.

Until reflections return from the edges, the contact point of a thin plate is a dashpot. Image
sources say when they return. How much they matter depends on the force that the law may give.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from hertzloop.controller.law import ForceBound
from hertzloop.plant.estimates.reflections import Actuation, Reflections, looks_until_s, reflections
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.mechanics import Mechanics


@dataclass(frozen=True)
class Smoothness:
    """What the line from sensor to actuator does to the smoothness of a force: whether it is
    `smooth`, that is without steps and losses, and its latency (s)."""

    smooth: bool
    latency_s: float


_LEAST_HORIZON = -12  # power of two, 0.24 ms: most first impacts are over then
_LONGER = 2.0  # the delay that a law may latch, against the contact without control


def infinite_plate_possible(mechanics: Mechanics, scheme: str, reach: ForceBound) -> bool:
    """Whether the infinite plate can stand for the modes at all: reflections are known of simply
    supported edges, and a force of more than the contact's own has no known limit."""
    bounded = reach.force_n < math.inf or reach.share <= 1.0
    supported = mechanics.structure.separable is not None
    ideal = mechanics.actuator.ideal and mechanics.contact.limit is None
    known = bool(SCHEMES[scheme].infinite_plate) and ideal and not mechanics.radiating_faces
    sensed = mechanics.sensor_point_m is None and not mechanics.sensor_mass_kg
    return known and sensed and mechanics.same_point and bounded and supported


def _horizon_s(until_s: float) -> float:
    """A time up to which many questions look alike: the next power of two, s."""
    if until_s == math.inf:
        return until_s
    return 2.0 ** max(math.ceil(math.log2(until_s)), _LEAST_HORIZON)


@lru_cache(maxsize=16)
def infinite_plate_error(
    mechanics: Mechanics,
    scheme: str,
    reach: ForceBound,
    line: Smoothness,
    step_s: float,
    until_s: float,
) -> float:
    """Error that an infinite plate is expected to have at `until_s` after the first touch, relative
    to the penetration or the plate energy; inf where that is not known."""
    if until_s <= 0.0 or not infinite_plate_possible(mechanics, scheme, reach):
        return math.inf
    plate = mechanics.structure.separable
    assert plate is not None  # else it would not be possible
    horizon_s = _horizon_s(until_s)
    impact = mechanics.sphere, plate, mechanics.contact, mechanics.contact_point_m
    if until_s > looks_until_s(*impact):
        return math.inf
    found = reflections(*impact, horizon_s)
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, step_s, _actuation(mechanics, reach, line, found))


def infinite_plate_lasts_s(
    mechanics: Mechanics,
    scheme: str,
    reach: ForceBound,
    line: Smoothness,
    step_s: float,
    accuracy: float,
    at_most_s: float = math.inf,
) -> float:
    """How long after the first touch an infinite plate meets the accuracy, s; zero where it does
    not do so for a whole contact. It is not looked for beyond `at_most_s`."""
    plate = mechanics.structure.separable
    if plate is None or not infinite_plate_possible(mechanics, scheme, reach):
        return 0.0
    found = reflections(
        mechanics.sphere, plate, mechanics.contact, mechanics.contact_point_m, _horizon_s(at_most_s)
    )
    lasts = found.lasts_s(accuracy, step_s, _actuation(mechanics, reach, line, found))
    return min(lasts, at_most_s) if lasts >= found.contact_s else 0.0


def _actuation(
    mechanics: Mechanics, reach: ForceBound, line: Smoothness, found: Reflections
) -> Actuation:
    """What the actuator may do.

    A law that copies the contact force is as smooth as that, unless the line from sensor to
    actuator is not, with a delay of at most a contact, which it makes longer; any other counts
    as switched on and off at the largest force.
    """
    if reach.force_n < math.inf:
        return Actuation(jumps_n=2.0 * reach.force_n)
    if reach.copies and line.smooth:
        return Actuation(reach.share, _LONGER * found.contact_s + line.latency_s)
    return Actuation(jumps_n=2.0 * reach.share * mechanics.rigid.peak_n)
