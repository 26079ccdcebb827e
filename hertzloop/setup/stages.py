"""The stages of resolving a scene: bodies, plate model, reach of the law, sensor and line.

Every stage is a plain function of the tables and numbers that it reads, and keeps its latest
results by these.
"""

import math
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

from hertzloop.controller.controller import LineSpec
from hertzloop.controller.law import About, Reach
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import (
    HERTZ,
    Contact,
    Damping,
    Hammer,
    Limit,
    RigidImpact,
    Sphere,
    hertz_stiffness,
    hunt_crossley_parameter,
    rigid_impact,
)
from hertzloop.plant.contact.yielding import Strength, deepest_rigid_m, softer, yield_depth_m
from hertzloop.plant.estimates.model_order import frequency_limit_hz, solid_limit_hz
from hertzloop.plant.estimates.plate_theory import expected_kirchhoff_error
from hertzloop.plant.estimates.reflections import (
    Actuation,
    Reflections,
    looks_until_s,
    reflections,
)
from hertzloop.plant.plant import MOST_MODES, PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Point
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import Description, structure
from hertzloop.plant.structures.structure import Structure, frequencies
from hertzloop.scenes.attached_files import unpack_modes
from hertzloop.scenes.controller_table import ControllerTable
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.materials import find_material
from hertzloop.scenes.plant_checks import not_in_three_dimensions
from hertzloop.scenes.quantities import SENSED, Expected
from hertzloop.scenes.tables import (
    ActuatorTable,
    ContactTable,
    HammerTable,
    MaterialTable,
    PlateTable,
    SensorsTable,
    Striker,
)
from hertzloop.sensors.acquisition import Fault, SensorSpec

KEPT = 16  # results of a stage; a structure's modes can be large


@dataclass(frozen=True)
class Bodies:
    """What collides, in SI units: everything that does not depend on step, law or sensor.

    `weaker`: the body that yields first, and its strength; None where the plate's is not known.
    `sensor_point_m`: of a sensor elsewhere; None at the contact point.
    `theory`: "kirchhoff" or "3d", the theory that `plate.theory` comes to.
    """

    sphere: Sphere
    structure: Structure
    contact: Contact
    actuator: Actuator
    contact_point_m: Point
    actuator_point_m: Point
    sensor_point_m: Point | None
    sensor_mass_kg: float
    radiating_faces: int
    weaker: tuple[str, Strength] | None
    theory: str
    rigid: RigidImpact = field(compare=False)
    """the same impact on a rigid plate"""
    why_not_solid: str | None = field(compare=False)
    """why the plate cannot be in three dimensions; None if it can"""

    same_point: bool = field(init=False, repr=False, compare=False)
    """whether the actuator pushes at the contact point"""
    mass_at_contact: bool = field(init=False, repr=False, compare=False)
    """whether the actuator's or the sensor's mass is on the contact point"""

    def __post_init__(self) -> None:
        """The hash is kept: later stages are looked up by it again and again."""
        same = self.contact_point_m == self.actuator_point_m
        of_sensor = self.sensor_mass_kg > 0.0 and self.sensor_point_m is None
        vars(self).update(
            same_point=same,
            mass_at_contact=of_sensor or (self.actuator.mass_kg > 0.0 and same),
            _hash=hash(tuple(getattr(self, part.name) for part in fields(self) if part.compare)),
        )

    def __hash__(self) -> int:
        kept: int = vars(self)["_hash"]
        return kept

    @property
    def local_plate(self) -> Plate:
        """The plate that the contact feels first. Raises SceneError where none is known."""
        if self.structure.local_plate is None:
            raise SceneError(
                "controller.law or sensors.full_scale needs the impedance of an infinite plate, "
                f"which is unknown for {self.structure}. Give plate.thickness_m if it is a plate "
                "at the contact point, or use another law and a numeric range."
            )
        return self.structure.local_plate


@dataclass(frozen=True)
class Smoothness:
    """What the line from sensor to actuator does to the smoothness of a force: whether it is
    `smooth`, that is without steps and losses, and its latency (s)."""

    smooth: bool
    latency_s: float


# First stage: the sphere, the structure, their contact and the actuator.


@lru_cache(maxsize=KEPT)
def bodies_of(
    striker: Striker,
    plate: PlateTable,
    contact_table: ContactTable,
    actuator_table: ActuatorTable,
    materials: tuple[MaterialTable, ...] | None,
    scheme: str,
    without_modes: bool,
    accuracy: float,
    sensor: tuple[Point | None, float],
) -> Bodies:
    """Build the bodies.

    Args:
        materials: the scene's own, by name.
        scheme: `run.scheme`; a solid plate is known to one of them only.
        without_modes: whether `run.plate_model` is "infinite"; such a plate is thin.
        accuracy: `run.accuracy`, by which the theory and the number of Ritz functions are chosen.
        sensor: point and mass (kg) of the sensor.

    Raises:
        SceneError: a file of modes does not make a structure.
    """
    of_plate = find_material(plate.material, materials or ())
    of_striker = find_material(striker.material, materials or ())
    try:
        description = _described(plate, of_plate, accuracy)
    except ValueError as error:
        raise SceneError(str(error)) from error
    sphere, contact, weaker = _impact(striker, contact_table, of_striker, of_plate)
    rigid = rigid_impact(sphere, contact)
    thin_only = not_in_three_dimensions(
        striker, plate, contact_table, actuator_table, scheme,
        "infinite" if without_modes else "auto",
        of_plate.orthotropic, sensor[1] or None,
    )  # fmt: skip
    theory = plate.theory
    if theory == "auto":
        theory = "kirchhoff"
        if not thin_only:
            expected = expected_kirchhoff_error(sphere, description.thin_plate, contact)
            theory = "kirchhoff" if expected.largest <= accuracy else "3d"
    contact_point, actuator_point = plate.points_m
    try:
        struck = structure("modes" if plate.modes else theory, description)
    except ValueError as error:
        raise SceneError(str(error)) from error
    return Bodies(
        sphere=sphere,
        structure=struck,
        contact=contact,
        actuator=Actuator(
            actuator_table.bandwidth_hz,
            actuator_table.damping,
            actuator_table.mass_kg or 0.0,
            actuator_table.force_limit_n,
        ),
        contact_point_m=contact_point,
        actuator_point_m=actuator_point,
        sensor_point_m=struck.sensor_at(contact_point, actuator_point, sensor[0]),
        sensor_mass_kg=sensor[1],
        radiating_faces=plate.radiating_faces,
        weaker=weaker,
        theory=theory,
        rigid=rigid,
        why_not_solid=thin_only[0] if thin_only else None,
    )


def _described(table: PlateTable, material: Material, accuracy: float) -> Description:
    modes = table.modes
    content = None if modes is None else unpack_modes(modes.file, modes.sha256, modes.content)
    return Description(
        material=material,
        size_m=table.size_m,
        thickness_m=table.thickness_m,
        loss_factor=table.loss_factor,
        edges=table.edges or "ssss",
        accuracy=accuracy,
        modes=None if modes is None or content is None else (modes.file, content),
        residual_flexibility_m_n=table.residual_flexibility_m_n,
    )


def _impact(
    striker: Striker, table: ContactTable, own: Material, plate: Material
) -> tuple[Sphere, Contact, tuple[str, Strength] | None]:  # fmt: skip
    """What strikes the plate, of a material of its `own`; its contact: stiffness, damping,
    exponent, and where it yields; and the body that yields first, see `Bodies`."""
    weaker = softer(plate, own)
    height, speed = getattr(striker, "drop_height_m", None), striker.speed_m_s
    if height is None:
        assert speed is not None  # a scene without either is refused
        height = speed**2 / (2.0 * GRAVITY_M_S2)
    sphere: Sphere
    stiffness, exponent = None, HERTZ
    if isinstance(striker, HammerTable):
        assert speed is not None
        radius = math.nan if striker.tip_radius_m is None else striker.tip_radius_m
        sphere = Hammer(own, radius, height, striker.mass_kg, speed, striker.bounces)
        stiffness, exponent = striker.tip_stiffness, striker.tip_exponent or HERTZ
    else:
        sphere = Sphere(own, striker.radius_m, height, striker.mass_kg, speed)
    if stiffness is None:
        stiffness = hertz_stiffness(sphere.radius_m, own, plate)
    if table.stiffness_factor is not None:
        stiffness *= table.stiffness_factor
    limit = None
    if table.plasticity == "thornton":
        pressure = table.limiting_pressure_pa
        if pressure is None:
            assert weaker is not None  # a scene without is refused
            pressure = weaker[1].pressure_pa
        limit = Limit(pressure, sphere.radius_m)
    damping: dict[str, Any] = {}
    if table.damping == "viscous":
        damping = {"damping": Damping.VISCOUS, "viscous_n_s_m": table.viscous_n_s_m}
    elif table.damping == "hunt_crossley":
        d = hunt_crossley_parameter(table.restitution, sphere.impact_speed_m_s)
        damping = {"damping": Damping.HUNT_CROSSLEY, "hunt_crossley_s_m": d}
    elif table.damping == "relaxation":
        damping = {
            "damping": Damping.RELAXATION,
            "relaxation_stiffness": table.relaxation_stiffness,
            "relaxation_s": table.relaxation_s,
            "extra_state": table.relaxation_solve == "bracketed",
        }
    return sphere, Contact(stiffness, limit=limit, exponent=exponent, **damping), weaker


# The plate: modes up to a frequency, what stands for the rest, and the infinite plate.
#
# Until reflections return from the edges, the contact point of a thin plate is a dashpot. Image
# sources say when they return; how much they matter depends on the force that the law may give.

_STEPS_OF_CONTACT = 10  # at least, for figures worth printing
NEAREST = 1.0  # wavelengths at the limit between the struck point and an edge, for a damped tail
_LOWEST_TAIL = 0.5  # of the last mode's frequency, for that from which on a damped tail stands
_LEAST_SHARE = 0.99  # of the frequency limit, for the lowest mode
_MASS_S = 5e-8  # processor time of a pair of modes under a mass, s
TOLD_S, _MOST_S = 2.0, 60.0  # of processor time for the modes: said, and refused
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
                f"{_FEWEST_PERIODS / lasts_s:.3g} Hz. Use a thinner plate, a larger radius, or "
                "'kirchhoff'."
            )
        raise SceneError(
            f"plate.theory = '3d' with {thick} and a contact of radius {radius:.2g} m: waves as "
            "short as the impact makes are no longer than the contact is wide, where Hertz contact "
            "is invalid. Use a smaller radius, a lower speed, or 'kirchhoff'."
        )
    return limit


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
    if plate.mode_table is not None and plate.highest_hz == 0.0:
        if asked == "auto":
            return False
        raise SceneError(
            f"plate.tail = 'damped' starts at the last mode, but {plate} end at 0 Hz. Use "
            "'spring', or give modes up to a higher frequency."
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
    if bodies.mass_at_contact or not _goes_on(plate, step_s):
        return False
    return wavelengths_to_edge(bodies, limit_hz) >= NEAREST


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
    lasts_s = bodies.rigid.contact_s
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
    if masses and _MASS_S * modes**2 > TOLD_S:
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


_LEAST_HORIZON = -12  # power of two, 0.24 ms: most first impacts are over then
_LONGER = 2.0  # the delay that a law may latch, against the contact without control


def infinite_plate_possible(bodies: Bodies, scheme: str, reach: Reach) -> bool:
    """Whether the infinite plate can stand for the modes at all: reflections are known of simply
    supported edges, and a force of more than the contact's own has no known limit."""
    bounded = reach.force_n < math.inf or reach.share <= 1.0
    supported = bodies.structure.separable is not None
    ideal = bodies.actuator.ideal and bodies.contact.limit is None
    known = bool(SCHEMES[scheme].infinite_plate) and ideal and not bodies.radiating_faces
    sensed = bodies.sensor_point_m is None and not bodies.sensor_mass_kg
    return known and sensed and bodies.same_point and bounded and supported


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
    horizon_s = _horizon_s(until_s)
    impact = bodies.sphere, plate, bodies.contact, bodies.contact_point_m
    if until_s > looks_until_s(*impact):
        return math.inf
    found = reflections(*impact, horizon_s)
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
    plate = bodies.structure.separable
    if plate is None or not infinite_plate_possible(bodies, scheme, reach):
        return 0.0
    found = reflections(
        bodies.sphere, plate, bodies.contact, bodies.contact_point_m, _horizon_s(at_most_s)
    )
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
    return Actuation(jumps_n=2.0 * reach.share * bodies.rigid.peak_n)


# The law: its reach, its sensor and its line.

# A law that looks ahead, as `predicted`, watches from twice the flight in its horizon on.
_RESONANCE_DAMPING = 0.02  # of a bare force cell
_FAULTY = 0.01  # of samples, where a scene does not say how many
_HORIZONS, _LEAST_FLIGHT_S = 2.5, 20e-6


@lru_cache(maxsize=KEPT)
def sensor_of(table: SensorsTable, bodies: Bodies, step_s: float, latency_us: float) -> SensorSpec:
    """The channel; `latency_us` of the line counts for the flight that the range has to hold."""
    return SensorSpec(
        of_state=_index_of(table.quantity, bodies),
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        low_pass=table.low_pass,
        low_pass_order=table.low_pass_order,
        full_scale=_full_scale(table, bodies, step_s, latency_us),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
        ac_coupling_hz=table.ac_coupling_hz,
        resonance_hz=table.resonance_hz,
        resonance_damping=(
            _RESONANCE_DAMPING if table.resonance_damping is None else table.resonance_damping
        ),
        fault=_fault_of(table, step_s),
    )


def _index_of(quantity: str, bodies: Bodies) -> int:
    """Index of a quantity in the state of the plant, where the sensor is."""
    elsewhere = SENSED[quantity].elsewhere
    if elsewhere is None or bodies.sensor_point_m is None:
        return SENSED[quantity].of_state
    return elsewhere


def _fault_of(table: SensorsTable, step_s: float) -> Fault | None:
    """The fault of a sensor, in samples; None of a sensor without one."""
    if table.fault is None:
        return None
    sample_s, lasts_s = step_s * table.every_steps, table.fault_duration_s
    lasts = None if lasts_s is None else max(1, round(lasts_s / sample_s))
    return Fault(
        kind=table.fault,
        start=round((table.fault_start_s or 0.0) / sample_s),
        lasts=lasts,
        size=table.fault_size or 0.0,
        probability=table.fault_probability or _FAULTY,
    )


def _full_scale(
    table: SensorsTable, bodies: Bodies, step_s: float, latency_us: float
) -> tuple[float, float] | None:
    """Range of the converter in units of its quantity; None without limits.

    "contact" takes the largest value of the contact on a rigid plate as its measure: F, its
    penetration (deeper where it yields), F/Z of the plate's velocity, and pi/T times that of its
    acceleration. "auto" is the same with the flight above the plate that a law has to see: that
    of the horizon with a window, and of 20 us at least.
    """
    if isinstance(table.full_scale, tuple):
        return table.full_scale
    if table.full_scale == "none" or table.bits == "ideal":
        return None
    contact = bodies.contact
    m, v = bodies.sphere.mass_kg, bodies.sphere.impact_speed_m_s
    rigid, flight_s = bodies.rigid, 0.0
    if table.full_scale == "auto":
        horizon_s = step_s + 1e-6 * latency_us
        flight_s = max(_HORIZONS * horizon_s, _LEAST_FLIGHT_S)
    force_n = rigid.peak_n
    return SENSED[table.quantity].range(
        Expected(
            rigid_m=rigid.deepest_m,
            deepest_m=max(rigid.deepest_m, deepest_rigid_m(contact, 0.5 * m * v * v)),
            flight_m=v * flight_s,
            force_n=force_n,
            velocity_m_s=lambda: force_n / bodies.local_plate.infinite_plate_impedance_n_s_m,
            contact_s=rigid.contact_s,
        )
    )


def models_yield(table: ControllerTable) -> bool:
    """Whether the law declares that it allows for a permanent dent; false if it is missing."""
    try:
        return table.loaded_law.models_yield
    except LawError:
        return False


def reach_of(table: ControllerTable) -> Reach:
    """How far the force of the law can go; without limit if the law is not there any more, as that
    of a recording may be. Raises SceneError."""
    try:
        law = table.loaded_law
    except LawError:
        return Reach()
    return _reach_of(table, law)


@lru_cache(maxsize=KEPT)
def _reach_of(table: ControllerTable, law: Law) -> Reach:
    try:
        return law.reach(table.keys)
    except LawError as error:
        raise SceneError(str(error)) from error


@lru_cache(maxsize=KEPT)
def about_impact(bodies: Bodies, s: float) -> About:
    """What a law may know of the bodies alone, with the contact stiffness `s`, N/m^exponent."""
    m, v = bodies.sphere.mass_kg, bodies.sphere.impact_speed_m_s
    local = bodies.structure.local_plate
    rigid = bodies.rigid
    if s != bodies.contact.stiffness:
        rigid = rigid_impact(bodies.sphere, replace(bodies.contact, stiffness=s))
    return About(
        stiffness=s,
        exponent=bodies.contact.exponent,
        sphere_mass_kg=m,
        impact_speed_m_s=v,
        impedance_n_s_m=local.infinite_plate_impedance_n_s_m if local else math.nan,
        rigid_contact_s=rigid.contact_s,
        rigid_peak_n=rigid.peak_n,
        yield_depth_m=yield_depth_m(bodies.contact),
    )


@lru_cache(maxsize=KEPT)
def about_bodies(
    bodies: Bodies, stiffness: float, line: LineSpec, step_ns: int, every_steps: int
) -> About:
    """What a law may know without a simulation and without the range of the converter."""
    limit_n = line.full_scale_n
    return replace(
        about_impact(bodies, stiffness),
        step_ns=step_ns,
        every_steps=every_steps,
        # The force of a sample acts one step after it at the earliest.
        horizon_steps=1 + line.latency_steps,
        limit_n=math.inf if limit_n is None else limit_n,
    )


@lru_cache(maxsize=KEPT)
def smoothness_of(
    control: ControllerTable, sensors: SensorsTable, line: LineSpec, latency_us: float
) -> Smoothness:
    """What sensor and line do to the smoothness of a law's force."""
    return Smoothness(
        smooth=sensors.bits == control.bits == "ideal"
        and sensors.every_steps == 1
        and sensors.noise_rms == control.jitter_us == 0.0
        and sensors.fault is None
        and line.jitter_steps == max(line.trace, default=0) == 0
        and line.stuck_step is None
        and control.drop_out_probability == 0.0
        and control.slew_n_s is None,
        latency_s=1e-6 * latency_us,
    )


@lru_cache(maxsize=KEPT)
def line_of(table: ControllerTable, actuator: ActuatorTable, step_ns: int) -> LineSpec:
    """The line from the law to the actuator."""

    def steps(time_us: float) -> int:
        return round(time_us * 1000 / step_ns)

    least_us = min(table.latency_trace) if table.latency_trace else table.latency_us
    least, stuck_s = steps(least_us), actuator.stuck_from_s
    return LineSpec(
        trace=tuple(steps(time_us) - least for time_us in table.latency_trace or ()),
        resampled=table.latency_trace_use == "resample",
        dead_steps=steps(actuator.dead_time_us or 0.0),
        stuck_step=None if stuck_s is None else steps(1e6 * stuck_s),
        latency_steps=least,
        jitter_steps=round(table.jitter_us * 1000 / step_ns),
        drop_out_probability=table.drop_out_probability,
        bits=None if table.bits == "ideal" else int(table.bits),
        full_scale_n=table.full_scale_n,
        slew_n_s=table.slew_n_s,
    )
