"""What stands for a plate in a run, where the scene leaves it to the program."""

import math

from hertzloop.plant_tables import contact_of
from hertzloop.scenes.problems import not_in_three_dimensions
from hertzloop.scenes.scene import Scene, SceneError
from plant.contact.hertz import Contact, Sphere, rigid_contact_time_s, rigid_penetration_m
from plant.estimates.model_order import expected_error, frequency_limit_hz, solid_limit_hz
from plant.estimates.plate_theory import KirchhoffError, expected_kirchhoff_error
from plant.plant import MOST_MODES, PlantSpec
from plant.schemes.registry import SCHEMES
from plant.structures.edged_plate import EdgedPlate
from plant.structures.modal_structure import ModalStructure
from plant.structures.plate import Plate
from plant.structures.solid_plate import SolidPlate
from plant.structures.structure import Structure, frequencies

_STEPS_OF_CONTACT = 10  # at least, for figures worth printing
NEAREST = 1.0  # wavelengths at the limit between the struck point and an edge, for a damped tail
_LOWEST_TAIL = 0.5  # of the last mode's frequency, for that from which on a damped tail stands
# Largest wave number times contact radius in three dimensions: from pi/2 on the contact in series
# with what is left of the modes left out is no longer monotone. A law may press four times deeper.
_WIDEST = 0.25 * math.pi
_MOST_BELOW = 0.5  # of the contact's own flexibility
_LEAST_SHARE = 0.99  # of the frequency limit, for the lowest mode
# Processor time of a mode, of one of a plate with edges, and of a pair of modes under a mass, s.
_MODE_S, _EDGED_MODE_S, _MASS_S = 1e-5, 7e-5, 5e-8
_TOLD_S, _MOST_S = 2.0, 60.0  # of processor time for the modes: said, and refused
_FEWEST_PERIODS = 1.5  # of the limit in a contact


def thin_plate(scene: Scene) -> Plate:
    """The plate of a scene by its sizes."""
    table = scene.plate
    assert table.size_m is not None
    assert table.thickness_m is not None
    return Plate(scene.material("plate"), table.size_m, table.thickness_m, table.loss_factor)


def theory(scene: Scene) -> str:
    """The theory of the plate, "kirchhoff" or "3d", that a scene's `plate.theory` means."""
    asked = scene.plate.theory
    if asked != "auto":
        return asked
    if not_in_three_dimensions(scene):
        return "kirchhoff"
    return "kirchhoff" if kirchhoff_error(scene).largest <= scene.run.accuracy else "3d"


def kirchhoff_error(scene: Scene) -> KirchhoffError:
    """What Kirchhoff's theory is expected to cost the first impact of a plate by its sizes."""
    ball, plate = scene.sphere, thin_plate(scene)
    sphere = Sphere(scene.material("sphere"), ball.radius_m, ball.drop_height_m)
    return expected_kirchhoff_error(sphere, plate, contact_of(scene, sphere, plate))


def widest_limit_hz(plate: SolidPlate, sphere: Sphere, contact: Contact) -> float:
    """Up to where modes can be taken along in three dimensions, Hz: where the branches end, or the
    contact is as wide as the waves. Raises SceneError where that leaves out the impact."""
    m, v = sphere.mass_kg, sphere.impact_speed_m_s
    deep = rigid_penetration_m(m, contact.stiffness, v)
    radius = math.sqrt(sphere.radius_m * deep)
    if contact.limit is not None:  # as wide as if yielding took all energy
        taken = 2.0 * m * v * v * sphere.radius_m / (math.pi * contact.limit.pressure_pa)
        radius = max(radius, taken**0.25)
    limit = min(plate.highest_hz, plate.frequency_hz(_WIDEST / radius))
    if limit * rigid_contact_time_s(m, contact.stiffness, v) < _FEWEST_PERIODS:
        thick = plate.plate.thickness_m
        raise SceneError(
            f"plate.theory = '3d' with plate.thickness_m = {thick:g} and a contact of radius "
            f"{radius:.2g} m: waves as short as the impact makes are no longer than the contact "
            "is wide, and Hertz's contact is not known there; take a smaller sphere, a lower "
            "drop, or 'kirchhoff'"
        )
    return limit


def check_below_zero(structure: ModalStructure, sphere: Sphere, contact: Contact) -> None:
    """Refuse a residual flexibility below zero, of the modes of a solid, where it does not fit."""
    left_out = structure.residual_flexibility_m_n(2.0 * math.pi * structure.highest_hz)
    if left_out >= 0.0:
        return
    s = contact.stiffness
    deep = rigid_penetration_m(sphere.mass_kg, s, sphere.impact_speed_m_s)
    named = f"{structure} with residual_flexibility_m_n = {left_out:.3g}, below zero,"
    if contact.has_damper:
        raise SceneError(
            f"{named} do not fit contact.damping: the spring below zero would answer a damper with "
            "more than it takes; take contact.plasticity for losses, or other modes"
        )
    if -left_out * 1.5 * s * math.sqrt(deep) > _MOST_BELOW:
        raise SceneError(
            f"{named} do not fit this contact, which is too stiff for it; take fewer modes, a "
            "smaller sphere, or a lower drop"
        )


def damped_tail(scene: Scene, plate: Structure, limit_hz: float) -> bool:
    """Whether the modes above a limit are one damped mode, not a spring.

    "auto" takes it where it is known: on a thin plate away from edges, whose modes end where it
    begins, without a mass on the struck point. Raises SceneError.
    """
    asked = scene.plate.tail
    tail = SCHEMES[scene.run.scheme].tail
    if asked == "spring" or not tail or isinstance(plate, SolidPlate):
        return False
    if plate.local_plate is None:
        if asked == "auto":
            return False
        raise SceneError(
            f"plate.tail = 'damped' needs the mobility of a plate, which is not known for {plate}; "
            "give plate.thickness_m if it is a plate where it is struck, or take 'spring'"
        )
    if isinstance(plate, ModalStructure) and plate.residual_flexibility_m_n(math.inf) < 0.0:
        if asked == "auto":
            return False
        raise SceneError(
            f"plate.tail = 'damped' does not fit {plate}, whose residual_flexibility_m_n is below "
            "zero, as of a solid's; take 'spring'"
        )
    if asked == "damped":
        return True
    away = wavelengths_to_edge(scene, plate, limit_hz) >= NEAREST
    return away and not mass_at_contact(scene) and _goes_on(plate, scene.step_s)


def _goes_on(plate: Structure, step_s: float) -> bool:
    """Whether what the modes of a file leave out is about as flexible as a plate above them: with
    more of it the damped mode would stand for modes that are there."""
    if not isinstance(plate, ModalStructure) or plate.local_plate is None:
        return True
    last = 2.0 * math.pi * min(plate.highest_hz, 0.5 / step_s)
    most = plate.local_plate.residual_flexibility_m_n(_LOWEST_TAIL * last)
    return plate.residual_flexibility_m_n(last) <= most


def wavelengths_to_edge(scene: Scene, plate: Structure, limit_hz: float) -> float:
    """How far the struck point is from the nearest edge, in lengths of bending waves at a limit;
    inf where modes come from a file and no edge is known."""
    if scene.plate.modes is not None or plate.local_plate is None:
        return math.inf
    return plate.local_plate.wavelengths_to_edge(scene.plate.points_m[0], limit_hz)


def mass_at_contact(scene: Scene) -> bool:
    """Whether the actuator's mass is on the struck point."""
    contact, actuator = scene.plate.points_m
    return scene.actuator.mass_kg is not None and contact == actuator


def check_step(scene: Scene, sphere: Sphere, contact: Contact) -> None:
    """Refuse a step that a contact may fit into: it would be seen as none, or as anything."""
    lasts_s = rigid_contact_time_s(sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s)
    if lasts_s < scene.step_s:
        raise SceneError(
            f"run.step_ns = {scene.run.step_ns} is longer than a contact, which may last only "
            f"{1e9 * lasts_s:.3g} ns; take at most {1e9 * lasts_s / _STEPS_OF_CONTACT:.1g}"
        )


def limit_hz_of(
    scene: Scene, sphere: Sphere, plate: Structure, contact: Contact
) -> tuple[float, bool]:
    """Up to where modes are taken along (Hz), and whether a damped mode stands for those beyond."""
    if scene.run.scheme == "thesis2008":  # all modes to pi/dt
        return 0.5 / scene.step_s, False
    if isinstance(plate, SolidPlate):
        highest = min(0.5 / scene.step_s, widest_limit_hz(plate, sphere, contact))
        return solid_limit_hz(sphere, plate, contact, highest, scene.run.accuracy), False
    limits = [
        frequency_limit_hz(
            sphere, plate, contact, scene.step_s, scene.run.accuracy,
            spring=SCHEMES[scene.run.scheme].tail, damped=damped,
        )
        for damped in (False, True)
    ]  # fmt: skip
    damped = damped_tail(scene, plate, limits[True])
    return limits[damped], damped


def check_reach(
    structure: ModalStructure, sphere: Sphere, contact: Contact, limit_hz: float
) -> None:
    """Refuse modes that leave out all of an impact, or a solid's with what does not fit those."""
    check_below_zero(structure, sphere, contact)
    if expected_error(sphere, structure, contact, limit_hz, spring=True) < 1.0:
        return
    lasts_us = 1e6 * rigid_contact_time_s(
        sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s
    )
    raise SceneError(
        f"{structure} reach up to {limit_hz:.3g} Hz, too low for an impact of {lasts_us:.3g} us; "
        f"give modes up to {5e5 / lasts_us:.2g} Hz at least (are they in Hz?)"
    )


def _sizes(scene: Scene) -> str:
    table = scene.plate
    return (
        f"plate.size_m = {list(table.size_m or ())} with plate.thickness_m = {table.thickness_m:g}"
    )


def check_lowest(scene: Scene, plate: Plate, limit_hz: float) -> None:
    """Raise SceneError for a plate with no modes up to a frequency."""
    if not plate.fundamental_hz < _LEAST_SHARE * limit_hz:
        raise SceneError(
            f"{_sizes(scene)} has its lowest mode at {plate.fundamental_hz:.3g} Hz, beyond the "
            f"{limit_hz:.3g} Hz that the run carries; take a larger or thinner plate, or a smaller "
            f"run.step_ns (now {scene.run.step_ns})"
        )


def check_modes(scene: Scene, plate: Structure, limit_hz: float) -> None:
    """Raise SceneError for a plate with no modes up to a frequency, or too many."""
    if isinstance(plate, Plate):
        check_lowest(scene, plate, limit_hz)
    modes = plate.modes_below(limit_hz)
    if modes > MOST_MODES:
        published = scene.run.scheme == "thesis2008"
        less = "another scheme" if published else f"more run.accuracy than {scene.run.accuracy:g}"
        raise SceneError(
            f"{_sizes(scene)} has about {modes:.2g} modes up to {limit_hz:.3g} Hz, the most is "
            f"{MOST_MODES}; take a smaller or thicker plate, or {less}"
        )


def build_s(spec: PlantSpec) -> float:
    """Return about how much processor time the plant's modes take, s."""
    if spec.infinite_plate:
        return 0.0
    modes = spec.plate.modes_below(spec.frequency_limit_hz)
    found = modes * (_EDGED_MODE_S if isinstance(spec.plate, EdgedPlate) else _MODE_S)
    if spec.actuator.mass_kg > 0.0 and _MASS_S * modes**2 > _TOLD_S:
        limit = 2.0 * math.pi * spec.frequency_limit_hz
        felt = frequencies(spec.plate, spec.contact_point_m, spec.actuator_point_m, limit)
        found += _MASS_S * felt**2
    return found


def check_build(spec: PlantSpec) -> None:
    """Raise SceneError for a plant whose modes would take too long."""
    takes_s = build_s(spec)
    if takes_s > _MOST_S:
        modes = spec.plate.modes_below(spec.frequency_limit_hz)
        raise SceneError(
            f"actuator.mass_kg = {spec.actuator.mass_kg:g}: on about {modes:.2g} modes it takes "
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
