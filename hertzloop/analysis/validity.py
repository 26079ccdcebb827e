"""Which effects a run neglects: one row an indicator, evaluated from the run's largest force, the
length of that contact and the largest deflection.

A row has an effect, the formula, a threshold, and from where on it is beyond what the model can be
(out of range). Sources are with the formulas, in hertzloop.plant.estimates.plate_theory and
hertzloop.plant.structures.plate_theory. The sentence on an effect is in hertzloop.views.effects.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.analysis.impacts import impacts_of_rows
from hertzloop.analysis.meters import Extremes, ExtremesMeter, StabilityMeter
from hertzloop.loop.compiled import simulate
from hertzloop.plant.contact.hertz import Sphere
from hertzloop.plant.contact.yielding import Strength
from hertzloop.plant.estimates import plate_theory as criteria
from hertzloop.plant.estimates.plate_theory import KirchhoffError, kirchhoff_error, thickness_number
from hertzloop.plant.estimates.plate_theory import zener_inelasticity as inelasticity
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.collocation import flexibility_m_n
from hertzloop.plant.structures.plate import Plate
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup
from hertzloop.setup.bodies import Bodies, cached_property

_MOST_STEPS = 2_000_000  # that are simulated in memory
_TAKES_ALL = 1.0  # lambda from which on the plate takes all energy, whatever its theory
_SQUARE = 1e-3  # difference of the sides up to which a plate is square
_DIGITS = 3  # of length and force, for what takes an integral that is kept


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


@dataclass(frozen=True)
class Standing:
    """Indicators that no run changes, of a plant and its bodies. What is unknown is nan."""

    spec: PlantSpec
    bodies: Bodies

    @cached_property
    def local(self) -> Plate | None:
        """The plate at the contact point, if it is one."""
        return self.spec.plate.local_plate

    @cached_property
    def weaker(self) -> tuple[str, Strength] | None:
        """Which body yields first, and its strength."""
        return self.bodies.weaker

    @cached_property
    def first_yield_pa(self) -> float:
        """Centre pressure at which the weaker body yields, Pa."""
        return self.weaker[1].first_yield_pa if self.weaker else math.nan

    @cached_property
    def fully_plastic_share(self) -> float:
        """Centre pressure over that of first yield, where the mean pressure is the hardness."""
        if self.weaker is None:
            return math.nan
        return 1.5 * self.weaker[1].pressure_pa / self.first_yield_pa

    @cached_property
    def zener(self) -> float:
        """Zener's lambda."""
        return inelasticity(self.spec.sphere, self.spec.local_plate, self.spec.contact)

    @cached_property
    def revival_s(self) -> float:
        """When a square plate's modes are in phase again, s; zero for what has no such time."""
        plate = self.spec.plate.separable
        if plate is None or self.spec.infinite_plate:
            return 0.0
        x, y = plate.size_m
        return criteria.revival_s(plate, x) if abs(x - y) <= _SQUARE * x else 0.0

    @cached_property
    def air_share(self) -> float:
        """Loss factor by air over the plate's own."""
        plate = self.spec.plate
        if self.local is None or plate.solid or plate.mode_table is not None:
            return math.nan
        own = self.local.eta
        return criteria.air_loss_factor(self.local) / own if own else math.inf

    @cached_property
    def squeezed_film(self) -> float:
        """Share of the sphere's energy that the film of air takes."""
        return criteria.squeezed_film(self.spec.sphere)

    @cached_property
    def drag(self) -> float:
        """Share of the energy of the fall that drag takes."""
        return criteria.drag_on_the_drop(self.spec.sphere)

    @cached_property
    def flexibility_m_n(self) -> float:
        """The spring of the modes left out, m/N."""
        return flexibility_m_n(self.spec)


_standing = lru_cache(maxsize=16)(Standing)


@dataclass(frozen=True)
class Facts:
    """A scene, its plant and the largest values of its run until `end_s`, by default all of it, s;
    what is not known is nan."""

    setup: Setup
    spec: PlantSpec
    run: Extremes
    end_s: float | None = None

    @cached_property
    def standing(self) -> Standing:
        """What no run changes."""
        return _standing(self.spec, self.setup.bodies)

    @property
    def sphere(self) -> Sphere:
        """The sphere."""
        return self.spec.sphere

    @property
    def local(self) -> Plate | None:
        """The plate at the contact point, if it is one."""
        return self.standing.local

    @property
    def accuracy(self) -> float:
        """What the scene asks for."""
        return self.setup.accuracy

    @cached_property
    def contact_radius_m(self) -> float:
        """At the largest force, by Hertz, m."""
        contact = self.spec.contact
        return criteria.contact_radius_m(self.run.force_n, self.sphere.radius_m, contact.stiffness)

    @cached_property
    def mean_pressure_pa(self) -> float:
        """At the largest force, by Hertz, Pa."""
        return criteria.mean_pressure_pa(self.run.force_n, self.contact_radius_m)

    @property
    def weaker(self) -> tuple[str, Strength] | None:
        """Which body yields first, and its strength."""
        return self.standing.weaker

    @property
    def plasticity(self) -> str:
        """How the contact yields, "none" if it does not."""
        return str(self.setup.scene.contact.plasticity)

    @property
    def centre_pressure_share(self) -> float:
        """Centre pressure over that of first yield."""
        return 1.5 * self.mean_pressure_pa / self.standing.first_yield_pa

    @property
    def kh(self) -> float:
        """Wave number of bending at 1/T times the thickness."""
        return thickness_number(self.spec.local_plate, self.run.contact_s)

    @cached_property
    def kirchhoff(self) -> KirchhoffError:
        """What Kirchhoff's theory may cost."""
        return kirchhoff_error(
            self.spec.local_plate, self.spec.contact.stiffness, _short(self.run.contact_s),
            _short(self.run.force_n),
        )  # fmt: skip

    @property
    def after_touch_s(self) -> float:
        """From the first touch to the end of the run, s."""
        end_s = self.setup.duration_s if self.end_s is None else self.end_s
        return end_s - self.run.touched_s

    @property
    def first_return_s(self) -> float:
        """When bending waves are back from an edge, s."""
        size = self.setup.size_m
        if self.local is None or size is None or self.spec.plate.mode_table is not None:
            return math.nan
        point = self.spec.contact_point_m
        return criteria.first_return_s(self.local, size, point, self.run.contact_s)

    @property
    def misses_reflections(self) -> bool:
        """Whether the plate has no edges, and that costs more than is asked for."""
        if not self.spec.infinite_plate:
            return False
        end_s = self.setup.duration_s if self.end_s is None else self.end_s
        return not self.setup.infinite_plate_error_at(end_s) <= self.accuracy

    @property
    def revival_s(self) -> float:
        """When a square plate's modes are in phase again, s; zero for what has no such time."""
        return self.standing.revival_s

    @property
    def controlled(self) -> bool:
        """Whether there is a law."""
        return self.setup.has_law

    @property
    def has_bandwidth(self) -> bool:
        """Whether the actuator's delay is in the model."""
        return self.spec.actuator.bandwidth_hz is not None

    @property
    def delay_s(self) -> float:
        """From a sample to the force that it causes, s."""
        setup = self.setup
        low_pass = setup.sensor.low_pass_hz
        sensor_s = 1.0 / (2.0 * math.pi * low_pass) if low_pass else 0.0
        line_s = setup.step_s + 1e-6 * setup.latency_us
        return line_s + self.spec.actuator.delay_s + sensor_s

    @property
    def clipped_share(self) -> float | None:
        """Largest force of the actuator over its limit; None without a force."""
        if self.run.actuator_n == 0.0:
            return None
        limit = self.spec.actuator.force_limit_n
        return math.nan if limit is None else self.run.actuator_n / limit

    @property
    def mass_that_matters_kg(self) -> float:
        """Mass on the plate from which on it counts, kg."""
        if self.local is None:
            return math.nan
        return criteria.mass_that_matters_kg(self.sphere, self.local, self.run.contact_s)

    @property
    def actuator_mass_share(self) -> float | None:
        """The actuator's mass against that; nan where the scene has none, None without a law."""
        mass = self.spec.actuator.mass_kg
        if mass:
            return mass / self.mass_that_matters_kg
        return math.nan if self.controlled else None

    @property
    def solid(self) -> bool:
        """Whether the plate is an elastic solid."""
        return self.spec.plate.solid

    @cached_property
    def flight_m(self) -> float:
        """How far above the plate the law looks, m; zero of one that waits for the contact."""
        try:
            return self.setup.law_flight_m()
        except SceneError:  # a recording may outlive its law
            return 0.0

    @property
    def flight_share(self) -> float | None:
        """That over the range of the sensor above the plate; None where it does not matter."""
        if self.setup.quantity != "xi" or not self.controlled:
            return None
        limits = self.setup.sensor.full_scale
        if limits is None or self.flight_m == 0.0:
            return None
        return self.flight_m / limits[1] if limits[1] > 0.0 else math.inf


class EffectState(StrEnum):
    """What a run does with an effect."""

    WITHIN = "within"
    LEFT_OUT = "left out"
    OUT_OF_RANGE = "out of range"
    IN_THE_MODEL = "in the model"
    NOT_KNOWN = "not known"


# A member of an enumeration is looked up in ten times the time of a name.
_WITHIN, _LEFT_OUT, _OUT_OF_RANGE, _IN_THE_MODEL, _NOT_KNOWN = EffectState


class Effect(StrEnum):
    """Effects with an indicator, by the names that JSON and the results of a sweep have."""

    YIELD = "yield"
    WIDE_ON_SPHERE = "contact against sphere"
    WIDE_ON_PLATE = "contact against plate"
    THEORY_ENERGY = "plate theory (energy)"
    THEORY_PEAK = "plate theory (peak)"
    LARGE_DEFLECTION = "large deflection"
    SPHERE_VIBRATION = "vibration of the sphere"
    THICKNESS_RESONANCE = "thickness resonance"
    REFLECTIONS = "reflections"
    LOOP_DELAY = "delay of the loop"
    ACTUATOR_FORCE = "force of the actuator"
    ACTUATOR_MASS = "mass of the actuator"
    AIR_ON_MODES = "air on the modes"
    AIR_FILM = "squeezed air film"
    DRAG = "drag on the drop"
    SENSOR_RANGE = "range of the sensor"
    DAMPER_BEHIND_SPRING = "damper behind a spring"
    REFOCUSING = "edge refocusing"


@dataclass(frozen=True)
class Finding:
    """An indicator of a run: `value` against `threshold` (nan where either is not known), and
    `state`; `beyond` is where "out of range" begins, inf if nowhere."""

    effect: Effect
    formula: str
    value: float
    threshold: float
    beyond: float
    state: EffectState


class EffectRow(NamedTuple):
    """One indicator. `threshold` None: the accuracy that the scene asks for. `falls`: it is a least
    value and not a largest. `modelled`: whether the scene puts the effect into the model. `value`
    is nan where it is not known, None where there is nothing to say."""

    effect: Effect
    formula: str
    threshold: float | None
    beyond: float
    value: Callable[[Facts], float | None]
    modelled: Callable[[Facts], bool] | None = None
    falls: bool = False


ROWS = (
    EffectRow(
        Effect.YIELD, "p_0 / (1.6 Y), p_0 = 3 F/(2 pi a^2)", 1.0, math.nan,
        lambda f: f.centre_pressure_share, lambda f: f.plasticity != "none",
    ),
    EffectRow(
        Effect.WIDE_ON_SPHERE, "a / R", 0.1, 0.3,
        lambda f: f.contact_radius_m / f.sphere.radius_m,
    ),
    EffectRow(
        Effect.WIDE_ON_PLATE, "a / h", 0.25, 0.5,
        lambda f: f.contact_radius_m / f.spec.local_plate.thickness_m,
    ),
    EffectRow(
        Effect.THEORY_ENERGY, "0.085 (k h)^2 at 1/T, where lambda < 1", None, 0.1,
        lambda f: f.kirchhoff.plate_energy if f.standing.zener < _TAKES_ALL else None,
        lambda f: f.solid,
    ),
    EffectRow(
        Effect.THEORY_PEAK, "dC 3/2 s^(2/3) F^(1/3)", None, 0.5,
        lambda f: f.kirchhoff.peak_force, lambda f: f.solid,
    ),
    EffectRow(
        Effect.LARGE_DEFLECTION, "w_max / h", 0.2, 1.0,
        lambda f: f.run.deflection_m / f.spec.local_plate.thickness_m,
    ),
    EffectRow(
        Effect.SPHERE_VIBRATION, "T 2.65 c_T/(2 pi R)", 3.0, 1.0,
        lambda f: criteria.sphere_periods(f.sphere, f.run.contact_s), falls=True,
    ),
    EffectRow(
        Effect.THICKNESS_RESONANCE, "T c_T/(2 h)", 3.0, 1.0,
        lambda f: criteria.thickness_periods(f.spec.local_plate, f.run.contact_s),
        lambda f: f.solid, falls=True,
    ),
    EffectRow(
        Effect.REFLECTIONS, "time after the touch / first return", 1.0, 10.0,
        lambda f: f.after_touch_s / f.first_return_s, lambda f: not f.misses_reflections,
    ),
    EffectRow(
        Effect.LOOP_DELAY, "(latency + 1 step + 2 zeta/omega_n + sensor) / T", 0.1, math.nan,
        lambda f: f.delay_s / f.run.contact_s if f.controlled else None,
    ),
    EffectRow(
        Effect.ACTUATOR_FORCE, "max F_a / actuator.force_limit_n", 0.999, math.nan,
        lambda f: f.clipped_share,
    ),
    EffectRow(
        Effect.ACTUATOR_MASS, "m_a / min(0.05 m_s, 0.05 Z T/(2 pi))", 1.0, math.nan,
        lambda f: f.actuator_mass_share, lambda f: bool(f.spec.actuator.mass_kg),
    ),
    EffectRow(
        Effect.AIR_ON_MODES, "rho0 c/(omega m'' eta), one face", 0.1, math.nan,
        lambda f: f.standing.air_share, lambda f: bool(f.spec.radiating_faces),
    ),
    EffectRow(
        Effect.AIR_FILM, "6 pi mu R^2 ln(R/1e-7 m) v/(m v^2/2)", 1e-3, 0.1,
        lambda f: f.standing.squeezed_film,
    ),
    EffectRow(
        Effect.DRAG, "3/8 C_D rho0 H/(rho_s R)", 1e-3, 0.1,
        lambda f: f.standing.drag,
    ),
    EffectRow(
        Effect.SENSOR_RANGE, "v (latency + window) / range above the plate", 1.0, math.nan,
        lambda f: f.flight_share,
    ),
    EffectRow(
        Effect.DAMPER_BEHIND_SPRING, "2.5 d R_0 F/T", None, 0.1,
        lambda f: criteria.tail_share(
            f.spec.contact.hunt_crossley_s_m, f.standing.flexibility_m_n, f.run.force_n,
            f.run.contact_s,
        ) if f.spec.contact.hunt_crossley_s_m else None,
        lambda f: f.spec.damped_tail,
    ),
    EffectRow(
        Effect.REFOCUSING, "time after the touch / revival of a square plate", 1.0, math.nan,
        lambda f: f.after_touch_s / f.revival_s if f.revival_s else None,
    ),
)  # fmt: skip


# What has a size only where the structure is a plate at the contact point.
OF_PLATE = (
    Effect.WIDE_ON_PLATE, Effect.THEORY_ENERGY, Effect.THEORY_PEAK, Effect.LARGE_DEFLECTION,
    Effect.THICKNESS_RESONANCE,
)  # fmt: skip
_WITHOUT_PLATE = tuple(row for row in ROWS if row.effect not in OF_PLATE)


@dataclass(frozen=True)
class Neglected:
    """Every indicator that says something about a run, and what they were computed from; none of a
    loop that is not `stable`."""

    facts: Facts | None
    findings: Sequence[Finding] = ()
    stable: bool = True


def neglected(setup: Setup, run: Extremes) -> Neglected:
    """All indicators of a run."""
    facts = Facts(setup, setup.plant, run)
    return Neglected(facts, findings(facts))


def neglected_of_scene(setup: Setup) -> Neglected:
    """The same of a scene, simulated here, the beginning of a very long one."""
    setup = setup.lasting(min(setup.steps, _MOST_STEPS))
    rows = simulate(setup).rows
    stability, extremes = StabilityMeter(setup), ExtremesMeter(setup.plant)
    stability.feed(0, rows)
    extremes.feed(0, rows)
    if stability.result().unstable:
        return Neglected(None, stable=False)
    with np.errstate(over="ignore", invalid="ignore"):
        impacts = [found.impact for found in impacts_of_rows(setup, rows)]
    return neglected(setup, extremes.result(impacts))


def names_by_state(facts: Facts) -> dict[EffectState, str]:
    """Names of the indicators in each state, as the results of a sweep have them."""
    names: dict[EffectState, list[str]] = {}
    for row, *_, state in _evaluated(facts):
        if state in names:
            names[state].append(row.effect)
        else:
            names[state] = [row.effect]
    return {state: ", ".join(some) for state, some in names.items()}


def findings(facts: Facts) -> list[Finding]:
    """Every indicator that says something about a run."""
    return [
        Finding(row.effect, row.formula, value, threshold, beyond, state)
        for row, value, threshold, beyond, state in _evaluated(facts)
    ]


def _evaluated(facts: Facts) -> Iterator[tuple[EffectRow, float, float, float, EffectState]]:
    """Rows that say something about a run: value, threshold, where out of range begins, state."""
    if not facts.run.force_n > 0.0 or not facts.run.contact_s > 0.0:
        return  # without a contact nothing is left out of it
    for row in ROWS if facts.local else _WITHOUT_PLATE:
        effect, _, threshold, beyond, value_of, modelled, falls = row
        value = value_of(facts)
        if value is None:
            continue
        if threshold is None:
            threshold = facts.accuracy
        if effect is Effect.YIELD:
            beyond = facts.standing.fully_plastic_share
        if modelled is not None and modelled(facts):
            state = _IN_THE_MODEL
        elif value != value:
            state = _NOT_KNOWN
        elif value < beyond if falls else value > beyond:
            state = _OUT_OF_RANGE
        elif value < threshold if falls else value > threshold:
            state = _LEFT_OUT
        else:
            state = _WITHIN
        yield row, value, threshold, beyond, state
