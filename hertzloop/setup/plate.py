"""Stages 2 and 4: the modes up to a frequency, what stands for the rest, and the infinite plate.

Until reflections return from the edges, the contact point of a thin plate is a dashpot. Image
sources say when they return; how much they matter depends on the force that the law may give, so
stage 4 needs the law's reach (stage 3).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from hertzloop.controller.law import Reach
from hertzloop.plant.contact.hertz import Contact, Sphere, rigid_impact
from hertzloop.plant.estimates.model_order import frequency_limit_hz, least_limit_hz, solid_limit_hz
from hertzloop.plant.estimates.reflections import (
    Actuation,
    Reflections,
    looks_until_s,
    reflections,
)
from hertzloop.plant.plant import MOST_MODES, PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.structure import Structure, frequencies
from hertzloop.scenes.errors import SceneError
from hertzloop.setup.bodies import KEPT, Bodies

_STEPS_OF_CONTACT = 10  # at least, for figures worth printing
NEAREST = 1.0  # wavelengths at the limit between the struck point and an edge, for a damped tail
_LOWEST_TAIL = 0.5  # of the last mode's frequency, for that from which on a damped tail stands
_MOST_BELOW = 0.5  # of the contact's own flexibility
_LEAST_SHARE = 0.99  # of the frequency limit, for the lowest mode
_MASS_S = 5e-8  # processor time of a pair of modes under a mass, s
_TOLD_S, _MOST_S = 2.0, 60.0  # of processor time for the modes: said, and refused
_FEWEST_PERIODS = 1.5  # of the limit in a contact


@lru_cache(maxsize=KEPT)
def described(
    bodies: Bodies, tail: str, scheme: str, step_ns: int, lead_in_s: float, accuracy: float
) -> PlantSpec:
    """Describe the plant with modes; whether these can be computed is not checked.

    Args:
        tail: `plate.tail`, what stands for the modes left out.
        lead_in_s: flight before the first contact.
        accuracy: relative error that leaving out modes may cause.

    Raises:
        SceneError: a contact would fit into a step, or the structure does not fit the contact.
    """
    step_s = step_ns * 1e-9
    _check_step(bodies, step_ns)
    limit, damped = _limit_hz(bodies, tail, scheme, step_s, accuracy)
    if bodies.structure.mode_table is not None:
        limit = min(bodies.structure.highest_hz, 0.5 / step_s)
    return PlantSpec(
        sphere=bodies.sphere,
        plate=bodies.structure,
        contact=bodies.contact,
        contact_point_m=bodies.contact_point_m,
        actuator_point_m=bodies.actuator_point_m,
        step_s=step_s,
        frequency_limit_hz=limit,
        lead_in_s=lead_in_s,
        residual_flexibility=SCHEMES[scheme].supports_tail,
        damped_tail=damped,
        actuator=bodies.actuator,
        radiating_faces=bodies.radiating_faces,
        sensor_point_m=bodies.sensor_point_m,
        sensor_mass_kg=bodies.sensor_mass_kg,
        tail_asked=bodies.structure.mode_table is not None and tail != "auto",
    )


@lru_cache(maxsize=KEPT)
def with_modes(spec: PlantSpec, step_ns: int, scheme: str, accuracy: float) -> PlantSpec:
    """The plant with the modes of its structure. Raises SceneError if they are none or too many."""
    if spec.plate.mode_table is None:
        _check_modes(spec, step_ns, scheme, accuracy)
    _check_build(spec)
    return spec


@lru_cache(maxsize=KEPT)
def without_edges(spec: PlantSpec, step_ns: int) -> PlantSpec:
    """The plant with an infinite plate. Raises SceneError for one with no modes below its limit."""
    _check_lowest(spec.plate, spec.frequency_limit_hz, step_ns)
    return replace(spec, residual_flexibility=False, damped_tail=False, infinite_plate=True)


def widest_limit_hz(plate: Structure, sphere: Sphere, contact: Contact) -> float:
    """Up to where modes can be taken along in three dimensions, Hz: where the branches end, or the
    contact is as wide as the waves. Raises SceneError where that leaves out the impact."""
    m, v, rigid = sphere.mass_kg, sphere.impact_speed_m_s, rigid_impact(sphere, contact)
    radius = math.sqrt(sphere.radius_m * rigid.deepest_m)
    if contact.limit is not None:  # as wide as if yielding took all energy
        taken = 2.0 * m * v * v * sphere.radius_m / (math.pi * contact.limit.pressure_pa)
        radius = max(radius, taken**0.25)
    limit = min(plate.highest_hz, plate.contact_limit_hz(radius))
    lasts_s = rigid.contact_s
    if limit * lasts_s < _FEWEST_PERIODS:
        local = plate.local_plate
        thick = f"plate.thickness_m = {local.thickness_m:g}" if local else str(plate)
        if limit == plate.highest_hz:
            raise SceneError(
                f"plate.theory = '3d' with {thick}: the modes of a solid end at {limit:.3g} Hz, "
                f"but the contact of {1e6 * lasts_s:.2g} us needs them to "
                f"{_FEWEST_PERIODS / lasts_s:.3g} Hz. Use a thinner plate, a larger sphere, or "
                "'kirchhoff'."
            )
        raise SceneError(
            f"plate.theory = '3d' with {thick} and a contact of radius {radius:.2g} m: waves as "
            "short as the impact makes are no longer than the contact is wide, where Hertz contact "
            "is invalid. Use a smaller sphere, a lower drop, or 'kirchhoff'."
        )
    return limit


def _check_below_zero(structure: Structure, sphere: Sphere, contact: Contact) -> None:
    """Refuse a residual flexibility below zero, of the modes of a solid, where it does not fit."""
    left_out = structure.residual_flexibility_m_n(2.0 * math.pi * structure.highest_hz)
    if left_out >= 0.0:
        return
    named = f"{structure} with residual_flexibility_m_n = {left_out:.3g}, below zero,"
    if contact.has_damper:
        raise SceneError(
            f"{named} do not fit contact.damping: a negative residual flexibility is unstable with "
            "a damper. Use contact.plasticity for losses, or other modes."
        )
    tangent = contact.exponent * contact.stiffness * rigid_impact(sphere, contact).rise
    if -left_out * tangent > _MOST_BELOW:
        raise SceneError(
            f"{named}: the contact is too stiff for these modes. Use fewer modes, a smaller "
            "sphere, or a lower drop."
        )


def _damped_tail(bodies: Bodies, asked: str, scheme: str, step_s: float, limit_hz: float) -> bool:
    """Whether the modes above a limit are one damped mode, not a spring.

    "auto" takes it where it is known: on a thin plate away from edges, whose modes end where it
    begins, without a mass on the contact point. Raises SceneError.
    """
    plate = bodies.structure
    if asked == "spring" or not SCHEMES[scheme].supports_tail or plate.solid:
        return False
    if plate.local_plate is None:
        if asked == "auto":
            return False
        raise SceneError(
            f"plate.tail = 'damped' the mobility of {plate} is unknown. Give "
            "plate.thickness_m if it is a plate at the contact point, or use 'spring'."
        )
    if plate.mode_table is not None and plate.residual_flexibility_m_n(math.inf) < 0.0:
        if asked == "auto":
            return False
        raise SceneError(
            f"plate.tail = 'damped' does not fit {plate}, whose residual_flexibility_m_n is below "
            "zero, as for a solid. Use 'spring'."
        )
    if asked == "damped":
        return True
    away = wavelengths_to_edge(bodies, limit_hz) >= NEAREST
    return away and not bodies.mass_at_contact and _goes_on(plate, step_s)


def _goes_on(plate: Structure, step_s: float) -> bool:
    """Whether what the modes of a file leave out is about as flexible as a plate above them: with
    more of it the damped mode would stand for modes that are there."""
    if plate.mode_table is None or plate.local_plate is None:
        return True
    last = 2.0 * math.pi * min(plate.highest_hz, 0.5 / step_s)
    most = plate.local_plate.residual_flexibility_m_n(_LOWEST_TAIL * last)
    return plate.residual_flexibility_m_n(last) <= most


def wavelengths_to_edge(bodies: Bodies, limit_hz: float) -> float:
    """How far the contact point is from the nearest edge, in lengths of bending waves at a limit;
    inf where modes come from a file and no edge is known."""
    plate = bodies.structure
    if plate.mode_table is not None or plate.local_plate is None:
        return math.inf
    return plate.local_plate.wavelengths_to_edge(bodies.contact_point_m, limit_hz)


def _check_step(bodies: Bodies, step_ns: int) -> None:
    """Refuse a step that a contact may fit into: it would be seen as none, or as anything."""
    lasts_s = rigid_impact(bodies.sphere, bodies.contact).contact_s
    if lasts_s < step_ns * 1e-9:
        raise SceneError(
            f"run.step_ns = {step_ns}: is longer than a contact of {1e9 * lasts_s:.3g} ns. Use at "
            f"most {1e9 * lasts_s / _STEPS_OF_CONTACT:.1g}."
        )


def _limit_hz(
    bodies: Bodies, tail: str, scheme: str, step_s: float, accuracy: float
) -> tuple[float, bool]:
    """Up to where modes are taken along (Hz), and whether a damped mode stands for those beyond."""
    sphere, plate, contact = bodies.sphere, bodies.structure, bodies.contact
    if not SCHEMES[scheme].limits_modes:
        return 0.5 / step_s, False
    if plate.solid:
        highest = min(0.5 / step_s, widest_limit_hz(plate, sphere, contact))
        return solid_limit_hz(sphere, plate, contact, highest, accuracy), False
    limits = [
        frequency_limit_hz(
            sphere,
            plate,
            contact,
            step_s,
            accuracy,
            spring=SCHEMES[scheme].supports_tail,
            damped=damped,
        )
        for damped in (False, True)
    ]
    damped = _damped_tail(bodies, tail, scheme, step_s, limits[True])
    return limits[damped], damped


def check_reach(spec: PlantSpec) -> None:
    """Refuse modes of a file that leave out all of an impact, unless an infinite plate stands for
    the rest or a tail was asked for; or a solid's with what does not fit those. In flight they are
    right all the same. Raises SceneError."""
    sphere, plate, contact = spec.sphere, spec.plate, spec.contact
    if plate.mode_table is None or spec.infinite_plate:
        return
    _check_below_zero(plate, sphere, contact)
    needed_hz = least_limit_hz(sphere, plate, contact, spec.frequency_limit_hz)
    if spec.frequency_limit_hz > needed_hz or spec.damped_tail or spec.tail_asked:
        return
    if needed_hz == math.inf:
        raise SceneError(
            f"contact.damping: is too large for {plate}, which leave out too much flexibility. "
            "Give modes up to a higher frequency, or less damping."
        )
    lasts_s = rigid_impact(sphere, contact).contact_s
    grain = 10.0 ** (math.floor(math.log10(needed_hz)) - 2)  # rounded up, to three digits
    raise SceneError(
        f"{plate} reach up to {spec.frequency_limit_hz:,.6g} Hz, too low for an impact of "
        f"{1e6 * lasts_s:.3g} us; give modes up to {(needed_hz // grain + 1) * grain:,.6g} Hz at "
        "least (are they in Hz?), plate.thickness_m if it is a plate at the contact point, or "
        "plate.tail = 'spring' to run with an error that is not known"
    )


def _sizes(plate: Structure) -> str:
    local = plate.local_plate
    assert local is not None
    return f"plate.size_m = {list(local.size_m)} with plate.thickness_m = {local.thickness_m:g}"


def _check_lowest(plate: Structure, limit_hz: float, step_ns: int) -> None:
    """Raise SceneError for a structure with no modes up to a frequency, where that is known."""
    lowest = plate.fundamental_hz
    if lowest is not None and not lowest < _LEAST_SHARE * limit_hz:
        raise SceneError(
            f"{_sizes(plate)} has its lowest mode at {lowest:.3g} Hz, beyond the {limit_hz:.3g} Hz "
            "that the step supports. Use a larger or thinner plate, or a smaller run.step_ns (now "
            f"{step_ns})."
        )


def _check_modes(spec: PlantSpec, step_ns: int, scheme: str, accuracy: float) -> None:
    """Raise SceneError for a plate with no modes up to its limit, or too many."""
    plate, limit_hz = spec.plate, spec.frequency_limit_hz
    _check_lowest(plate, limit_hz, step_ns)
    modes = plate.modes_below(limit_hz)
    if modes > MOST_MODES:
        limited = SCHEMES[scheme].limits_modes
        less = f"more run.accuracy than {accuracy:g}" if limited else "another scheme"
        raise SceneError(
            f"{_sizes(plate)} has about {modes:.2g} modes up to {limit_hz:.3g} Hz; the limit is "
            f"{MOST_MODES}. Use a smaller or thicker plate, or {less}."
        )


def build_s(spec: PlantSpec) -> float:
    """Return about how much processor time the plant's modes take, s."""
    if spec.infinite_plate:
        return 0.0
    modes = spec.plate.modes_below(spec.frequency_limit_hz)
    found = modes * spec.plate.seconds_per_mode
    masses = sum(mass > 0.0 for mass in spec.masses)
    if masses and _MASS_S * modes**2 > _TOLD_S:
        limit = 2.0 * math.pi * spec.frequency_limit_hz
        felt = frequencies(spec.plate, spec.contact_point_m, spec.actuator_point_m, limit)
        found += masses * _MASS_S * felt**2
    return found


def _check_build(spec: PlantSpec) -> None:
    """Raise SceneError for a plant whose modes would take too long."""
    takes_s = build_s(spec)
    if takes_s > _MOST_S:
        modes = spec.plate.modes_below(spec.frequency_limit_hz)
        key = "actuator" if spec.actuator.mass_kg else "sensors"
        mass_kg = spec.actuator.mass_kg or spec.sensor_mass_kg
        raise SceneError(
            f"{key}.mass_kg = {mass_kg:g}: on about {modes:.2g} modes it takes "
            f"about {takes_s:,.0f} s to compute, the most is {_MOST_S:g} s. Leave out the mass, or "
            "choose a smaller or thicker plate, or a larger run.accuracy."
        )


def build_words(spec: PlantSpec) -> str:
    """Return a sentence for a plant whose modes take a while; empty for any other."""
    takes_s = build_s(spec)
    if takes_s < _TOLD_S:
        return ""
    modes = spec.plate.modes_below(spec.frequency_limit_hz)
    return f"Computing about {modes:.2g} modes takes about {takes_s:.0f} s of processor time."


_LEAST_HORIZON = -12  # power of two, 0.24 ms: most first impacts are over then
_LONGER = 2.0  # the delay that a law may latch, against the contact without control


@dataclass(frozen=True)
class Smoothness:
    """What the line from sensor to actuator does to the smoothness of a force: whether it is
    `smooth`, that is without steps and losses, and its latency (s)."""

    smooth: bool
    latency_s: float


def infinite_plate_possible(bodies: Bodies, scheme: str, reach: Reach) -> bool:
    """Whether the infinite plate can stand for the modes at all: reflections are known of simply
    supported edges, and a force of more than the contact's own has no known limit."""
    bounded = reach.force_n < math.inf or reach.share <= 1.0
    supported = bodies.structure.separable is not None
    ideal = bodies.actuator.ideal and bodies.contact.limit is None
    known = SCHEMES[scheme].supports_infinite_plate and ideal and not bodies.radiating_faces
    sensed = bodies.sensor_point_m is None and not bodies.sensor_mass_kg
    return known and sensed and bodies.same_point and bounded and supported


@lru_cache(maxsize=KEPT)
def reflections_of(bodies: Bodies, until_s: float = math.inf) -> Reflections:
    """When reflections return to the contact point, as far as that is known `until_s` after the
    first touch. Raises SceneError where that is not known."""
    plate = bodies.structure.separable
    if plate is None:
        raise SceneError(f"reflections are unknown for {bodies.structure}")
    return reflections(bodies.sphere, plate, bodies.contact, bodies.contact_point_m, until_s)


def _horizon_s(until_s: float) -> float:
    """A time up to which many questions look alike: the next power of two, s."""
    if until_s == math.inf:
        return until_s
    return 2.0 ** max(math.ceil(math.log2(until_s)), _LEAST_HORIZON)


@lru_cache(maxsize=KEPT)
def infinite_plate_error(
    bodies: Bodies, scheme: str, reach: Reach, line: Smoothness, step_s: float, until_s: float
) -> float:
    """Error that an infinite plate is expected to have at `until_s` after the first touch, relative
    to the penetration or the plate energy; inf where that is not known."""
    if until_s <= 0.0 or not infinite_plate_possible(bodies, scheme, reach):
        return math.inf
    plate = bodies.structure.separable
    assert plate is not None  # else it would not be possible
    if until_s > looks_until_s(bodies.sphere, plate, bodies.contact, bodies.contact_point_m):
        return math.inf
    found = reflections_of(bodies, _horizon_s(until_s))
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, step_s, _actuation(bodies, reach, line, found))


def infinite_plate_lasts_s(
    bodies: Bodies,
    scheme: str,
    reach: Reach,
    line: Smoothness,
    step_s: float,
    accuracy: float,
    at_most_s: float = math.inf,
) -> float:
    """How long after the first touch an infinite plate meets the accuracy, s; zero where it does
    not do so for a whole contact. It is not looked for beyond `at_most_s`."""
    if not infinite_plate_possible(bodies, scheme, reach):
        return 0.0
    found = reflections_of(bodies, _horizon_s(at_most_s))
    lasts = found.lasts_s(accuracy, step_s, _actuation(bodies, reach, line, found))
    return min(lasts, at_most_s) if lasts >= found.contact_s else 0.0


def _actuation(bodies: Bodies, reach: Reach, line: Smoothness, found: Reflections) -> Actuation:
    """What the actuator may do.

    A law that copies the contact force is as smooth as that, unless the line from sensor to
    actuator is not, with a delay of at most a contact, which it makes longer; any other counts
    as switched on and off at the largest force.
    """
    if reach.force_n < math.inf:
        return Actuation(jumps_n=2.0 * reach.force_n)
    if reach.copies and line.smooth:
        return Actuation(reach.share, _LONGER * found.contact_s + line.latency_s)
    peak_n = rigid_impact(bodies.sphere, bodies.contact).peak_n
    return Actuation(jumps_n=2.0 * reach.share * peak_n)
