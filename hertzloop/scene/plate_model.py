"""The plant with modes: up to which frequency, and what stands for the modes above."""

import math
from dataclasses import replace
from functools import lru_cache

from hertzloop.common.protocols import Structure
from hertzloop.plant.estimates.model_order import frequency_limit_hz
from hertzloop.plant.plant import MOST_MODES, PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.structure import frequencies
from hertzloop.scene.errors import SceneError
from hertzloop.scene.mechanics import Mechanics

_STEPS_OF_CONTACT = 10  # at least, for metrics worth printing
# A damped residual mode needs this distance of the contact point from an edge, in wavelengths at
# the limit, and begins at this share of the last mode's frequency at least.
NEAREST, _LOWEST_RESIDUAL = 1.0, 0.5
_LEAST_SHARE = 0.99  # of the frequency limit, for the lowest mode
_MASS_S = 5e-8  # processor time of a pair of modes under a mass, s
WARN_ABOVE_S, _MOST_S = 2.0, 60.0  # of processor time for the modes: said, and refused


@lru_cache(maxsize=16)
def describe_plant(
    mechanics: Mechanics,
    truncated: str,
    scheme: str,
    step_ns: int,
    lead_in_s: float,
    accuracy: float,
) -> PlantSpec:
    """Describe the plant with modes; whether these can be computed is not checked.

    Args:
        truncated: `plate.tail`, what stands for the modes left out.
        lead_in_s: flight before the first contact.
        accuracy: relative error that leaving out modes may cause.

    Raises:
        SceneError: a contact would fit into a step, or the structure does not fit the contact.
    """
    step_s = step_ns * 1e-9
    _check_step(mechanics, step_ns)
    limit, damped = _limit_hz(mechanics, truncated, scheme, step_s, accuracy)
    if mechanics.structure.mode_table is not None:  # all of the file
        limit = min(mechanics.structure.highest_hz, 0.5 / step_s)
    return PlantSpec(
        sphere=mechanics.sphere,
        plate=mechanics.structure,
        contact=mechanics.contact,
        contact_point_m=mechanics.contact_point_m,
        actuator_point_m=mechanics.actuator_point_m,
        step_s=step_s,
        frequency_limit_hz=limit,
        lead_in_s=lead_in_s,
        residual_flexibility=SCHEMES[scheme].accepts("plate.tail", "spring"),
        damped_residual=damped,
        actuator=mechanics.actuator,
        sensor_point_m=mechanics.sensor_point_m,
        truncation_asked=mechanics.structure.mode_table is not None and truncated != "auto",
    )


def check_modes(spec: PlantSpec, step_ns: int, scheme: str, accuracy: float) -> PlantSpec:
    """The plant with the modes of its structure. Raises SceneError if they are none or too many."""
    if spec.plate.mode_table is None:
        _check_modes(spec, step_ns, scheme, accuracy)
    _check_build(spec)
    return spec


def on_infinite_plate(spec: PlantSpec, step_ns: int) -> PlantSpec:
    """The plant with an infinite plate. Raises SceneError for one with no modes below its limit."""
    _check_lowest(spec.plate, spec.frequency_limit_hz, step_ns)
    return replace(spec, residual_flexibility=False, damped_residual=False, infinite_plate=True)


def _damped_residual(
    mechanics: Mechanics, asked: str, scheme: str, step_s: float, limit_hz: float
) -> bool:
    """Whether the modes above a limit are one damped mode, not a spring.

    "auto" takes it where it is known: on a thin plate away from edges, whose modes end where it
    begins, without a mass on the contact point. Raises SceneError.
    """
    plate = mechanics.structure
    if asked == "spring" or not SCHEMES[scheme].accepts("plate.tail", "spring"):
        return False
    if why := _why_not_damped(plate):
        if asked == "auto":
            return False
        raise SceneError(f"plate.tail = 'damped': {why}")
    if asked == "damped":
        return True
    if mechanics.mass_at_contact or not _residual_fits_a_plate(plate, step_s):
        return False
    return _wavelengths_to_edge(mechanics, limit_hz) >= NEAREST


def _why_not_damped(plate: Structure) -> str:
    """Return why no damped mode can stand for the modes above a limit; "" if it can."""
    if plate.local_plate is None:
        return (
            f"the mobility of {plate} is unknown. Give plate.thickness_m if it is a plate at the "
            "contact point, or use 'spring'."
        )
    if plate.mode_table is None:
        return ""
    if plate.highest_hz == 0.0:
        return (
            f"it starts at the last mode, but {plate} end at 0 Hz. Use 'spring', or give modes up "
            "to a higher frequency."
        )
    return ""


def _residual_fits_a_plate(plate: Structure, step_s: float) -> bool:
    """Whether what the modes of a file leave out is about as flexible as a plate above them: with
    more of it the damped mode would stand for modes that are there."""
    if plate.mode_table is None or plate.local_plate is None:
        return True
    last = 2.0 * math.pi * min(plate.highest_hz, 0.5 / step_s)
    most = plate.local_plate.residual_flexibility_m_n(_LOWEST_RESIDUAL * last)
    return plate.residual_flexibility_m_n(last) <= most


def _wavelengths_to_edge(mechanics: Mechanics, limit_hz: float) -> float:
    """How far the contact point is from the nearest edge, in lengths of bending waves at a limit;
    inf where modes come from a file and no edge is known."""
    plate = mechanics.structure
    if plate.mode_table is not None or plate.local_plate is None:
        return math.inf
    return plate.local_plate.wavelengths_to_edge(mechanics.contact_point_m, limit_hz)


def _check_step(mechanics: Mechanics, step_ns: int) -> None:
    """Refuse a step that a contact may fit into: it would be seen as none, or as anything."""
    lasts_s = mechanics.rigid.contact_s
    if lasts_s < step_ns * 1e-9:
        raise SceneError(
            f"run.step_ns = {step_ns}: is longer than a contact of {1e9 * lasts_s:.3g} ns. Use at "
            f"most {max(int(1e9 * lasts_s / _STEPS_OF_CONTACT), 1)}."
        )


def _limit_hz(
    mechanics: Mechanics, truncated: str, scheme: str, step_s: float, accuracy: float
) -> tuple[float, bool]:
    """Up to where modes are taken along (Hz), and whether a damped mode stands for those beyond."""
    sphere, plate, contact = mechanics.sphere, mechanics.structure, mechanics.contact
    if not SCHEMES[scheme].limits_modes:
        return 0.5 / step_s, False
    spring = SCHEMES[scheme].accepts("plate.tail", "spring")
    limits = [
        min(
            plate.highest_hz,
            frequency_limit_hz(
                sphere, plate, contact, step_s, accuracy, spring=spring, damped=damped
            ),
        )
        for damped in (False, True)
    ]
    damped = _damped_residual(mechanics, truncated, scheme, step_s, limits[True])
    return limits[damped], damped


def _sizes(plate: Structure) -> str:
    """Return what decides the frequencies of a structure, for a message."""
    local = plate.local_plate
    if local is None:
        return f"{plate} (plate.theory)"
    return f"plate.size_m = {list(local.size_m)} with plate.thickness_m = {local.thickness_m:g}"


def _check_lowest(plate: Structure, limit_hz: float, step_ns: int) -> None:
    """Raise SceneError for a structure with no modes up to a frequency, where that is known."""
    lowest = plate.fundamental_hz
    if lowest is not None and not lowest < _LEAST_SHARE * limit_hz:
        raise SceneError(
            f"{_sizes(plate)} has its lowest mode at {lowest:.3g} Hz, beyond the {limit_hz:.3g} Hz "
            "that the step supports. Use a larger, thinner or softer structure, or a smaller "
            f"run.step_ns (now {step_ns})."
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


def build_time_s(spec: PlantSpec) -> float:
    """Return about how much processor time the plant's modes take, s."""
    if spec.infinite_plate:
        return 0.0
    modes = spec.plate.modes_below(spec.frequency_limit_hz)
    found = modes * spec.plate.seconds_per_mode
    if spec.actuator.mass_kg and _MASS_S * modes**2 > WARN_ABOVE_S:
        limit = 2.0 * math.pi * spec.frequency_limit_hz
        felt = frequencies(spec.plate, spec.contact_point_m, spec.actuator_point_m, limit)
        found += _MASS_S * felt**2
    return found


def _check_build(spec: PlantSpec) -> None:
    """Raise SceneError for a plant whose modes would take too long."""
    takes_s = build_time_s(spec)
    if takes_s > _MOST_S:
        modes = spec.plate.modes_below(spec.frequency_limit_hz)
        raise SceneError(
            f"actuator.mass_kg = {spec.actuator.mass_kg:g}: on about {modes:.2g} modes it takes "
            f"about {takes_s:,.0f} s to compute, the most is {_MOST_S:g} s. Leave out the mass, or "
            "choose a smaller or thicker plate, or a larger run.accuracy."
        )
