"""Which effects a run neglects: one row an effect, evaluated from the run's largest force, the
length of that contact and the largest deflection.

A row has the value and its formula, the threshold, from where on it is beyond what the model can be
(out of range), and the words. Sources are with the formulas, in
hertzloop.plant.estimates.plate_theory and hertzloop.plant.structures.plate_theory.
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
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.contact.yielding import Strength
from hertzloop.plant.estimates import plate_theory as criteria
from hertzloop.plant.estimates.model_order import (
    beyond_m_n,
    energy_beyond,
    expected_error,
    is_rigid,
    least_limit_hz,
)
from hertzloop.plant.estimates.plate_theory import KirchhoffError, thickness_number
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.collocation import flexibility_m_n
from hertzloop.plant.structures.plate import Plate
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup, model_error
from hertzloop.setup.controller import law_flight_m
from hertzloop.setup.mechanics import Mechanics

_MOST_STEPS = 2_000_000  # that are simulated in memory
_TAKES_ALL = 1.0  # lambda from which on the plate takes all energy, whatever its theory
_NOTHING_LEFT = 0.5  # expected error from which on a first impact is not to be trusted
_SQUARE = 1e-3  # difference of the sides up to which a plate is square
_DIGITS = 3  # of length and force, for what takes an integral that is kept


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


class _Standing(NamedTuple):
    """What no run changes; nan or None where it is unknown."""

    local: Plate | None  # the plate at the contact point, if it is one
    weaker: tuple[str, Strength] | None  # which body yields first
    zener: float  # Zener's lambda
    revival_s: float  # when a square plate's modes are in phase again; zero where that is never
    air_share: float  # loss factor by air over the plate's own
    squeezed_film: float  # share of the sphere's energy that the film of air takes
    drag: float  # share of the energy of the fall that drag takes
    flexibility_m_n: float  # the spring of the modes left out


@lru_cache(maxsize=16)
def _standing(spec: PlantSpec, bodies: Mechanics) -> _Standing:
    structure, local, sphere = spec.plate, spec.plate.local_plate, spec.sphere
    revival_s, air_share, square = 0.0, math.nan, structure.separable
    if square is not None and not spec.infinite_plate:
        x, y = square.size_m
        revival_s = criteria.revival_s(square, x) if abs(x - y) <= _SQUARE * x else 0.0
    if local is not None and not structure.solid and structure.mode_table is None:
        air_share = criteria.air_loss_factor(local) / local.eta if local.eta else math.inf
    return _Standing(
        local, bodies.weaker,
        math.nan if local is None else criteria.zener_inelasticity(sphere, local, spec.contact),
        revival_s, air_share, criteria.squeezed_film(sphere), criteria.drag_on_the_drop(sphere),
        flexibility_m_n(spec) if spec.contact.hunt_crossley_s_m else math.nan,
    )  # fmt: skip


class Facts:
    """What the rows below are evaluated from: a scene and the largest values of its run until
    `end_s`, by default all of it, s. What is not known is nan or None."""

    def __init__(self, setup: Setup, run: Extremes, end_s: float | None = None) -> None:
        self.setup, self.run, self.spec = setup, run, setup.plant
        lasts_s, peak_n = _short(run.contact_s), _short(run.force_n)
        # From a sample to the force that it causes.
        line_s = setup.step_s + 1e-6 * setup.latency_us
        self.delay_s = line_s + self.spec.actuator.delay_s + setup.sensor.low_pass_delay_s
        self.standing = _standing(self.spec, setup.mechanics)
        self.local = self.standing.local
        self.end_s = setup.duration_s if end_s is None else end_s
        self.after_touch_s = self.end_s - run.touched_s
        self.touched = run.force_n > 0.0 and run.contact_s > 0.0
        if not self.touched:  # without a contact nothing is left out of it
            return
        contact, sphere, radius_m = self.spec.contact, self.spec.sphere, self.spec.sphere.radius_m
        # Radius, m, and mean pressure, Pa, at the largest force by Hertz.
        self.radius_m = criteria.contact_radius_m(run.force_n, radius_m, contact.stiffness)
        self.pressure_pa = criteria.mean_pressure_pa(run.force_n, self.radius_m)
        self.sphere_periods = criteria.sphere_periods(sphere, run.contact_s)  # nan if it is no ball
        self.first_return_s = math.nan  # of bending waves from an edge, s
        if self.local is None:
            return
        self.thickness_periods = criteria.thickness_periods(self.local, run.contact_s)
        if setup.size_m is not None and self.spec.plate.mode_table is None:
            self.first_return_s = criteria.first_return_s(
                self.local, setup.size_m, self.spec.contact_point_m, run.contact_s
            )
        self.kirchhoff: KirchhoffError = criteria.kirchhoff_error(
            self.local, contact.stiffness, lasts_s, peak_n, contact.exponent
        )
        self.mass_that_matters_kg = criteria.mass_that_matters_kg(sphere, self.local, run.contact_s)

    @property
    def beyond_m_n(self) -> float:
        """Flexibility that stands for the modes beyond the limit, m/N."""
        return self.spec.plate.residual_flexibility_m_n(
            2.0 * math.pi * self.spec.frequency_limit_hz
        )

    @property
    def plasticity(self) -> str:
        """How the contact yields, "none" if it does not."""
        return str(self.setup.scene.contact.plasticity)

    def flight_m(self) -> float:
        """How far above the plate the law looks, m; zero of one that waits for the contact."""
        try:
            return law_flight_m(self.setup)
        except SceneError:  # a recording may outlive its law
            return 0.0


class EffectState(StrEnum):
    """What a run does with an effect."""

    WITHIN = "within"
    LEFT_OUT = "left out"
    OUT_OF_RANGE = "out of range"
    IN_THE_MODEL = "in the model"
    NOT_KNOWN = "not known"


# A member of an enumeration is looked up in ten times the time of a name.
_WITHIN, _LEFT_OUT, _OUT_OF_RANGE, _IN_THE_MODEL, _NOT_KNOWN = EffectState


@dataclass(frozen=True)
class Finding:
    """An effect in a run: `value` against `threshold` (nan where either is not known), and
    `state`; `beyond` is where "out of range" begins, inf if nowhere; the size in a `sentence`."""

    name: str
    formula: str
    value: float
    threshold: float
    beyond: float
    state: EffectState
    sentence: str


class EffectRow(NamedTuple):
    """One effect, by the name that JSON and the results of a sweep have.

    Attributes:
        name: The name.
        formula: Of the value.
        threshold: Above it the effect is left out. None: the accuracy that the scene asks for.
        beyond: From where on it is out of range, inf or nan if nowhere.
        value: nan where it is not known, None where there is nothing to say.
        words: A sentence on that value, without a full stop.
        brief: The same for one line; `{x}` is the value, `{p}` the value in percent.
        key: The key that puts the effect into the model.
        modelled: What of the scene puts it into the model, "" if nothing does.
        falls: Whether the value is a least one and not a largest.
        of_plate: Whether it has a size only where the structure is a plate at the contact point.
    """

    name: str
    formula: str
    threshold: float | None
    beyond: float | Callable[[Facts], float]
    value: Callable[[Facts], float | None]
    words: Callable[[Facts, float], str]
    brief: str = ""
    key: str = ""
    modelled: Callable[[Facts], str] | None = None
    falls: bool = False
    of_plate: bool = False


def _first_yield_pa(f: Facts) -> float:
    return f.standing.weaker[1].first_yield_pa if f.standing.weaker else math.nan


def _fully_plastic(f: Facts) -> float:
    """Centre pressure over that of first yield, where the mean pressure is the hardness."""
    weaker = f.standing.weaker
    return 1.5 * weaker[1].pressure_pa / weaker[1].first_yield_pa if weaker else math.nan


def _yields(f: Facts, x: float) -> str:
    if f.standing.weaker is None or math.isnan(x):
        return "when the plate yields is not known: give plate.material.yield_pa or hardness_pa"
    body, strength = f.standing.weaker
    words = (
        f"the {body} yields: mean pressure {pressure(f.pressure_pa)}, "
        f"{pressure(1.5 * f.pressure_pa)} in the centre, where yield begins at "
        f"{pressure(strength.first_yield_pa)}"
    )
    if f.pressure_pa > strength.pressure_pa:
        words += f" and is full at a mean of {pressure(strength.pressure_pa)}"
    return f"{words}; contact.plasticity = 'thornton' models it"


def _reflections(f: Facts) -> str:
    """In the model unless the plate has no edges, and that costs more than is asked for."""
    missed = f.spec.infinite_plate and not (
        model_error.infinite_plate_error_at(f.setup, f.end_s) <= f.setup.accuracy
    )
    return "" if missed else "reflections, as far as they are asked for"


def _modes_end(f: Facts) -> float | None:
    """Expected error of modes of a file that end below the impact, or beyond which there is
    nothing."""
    spec = f.spec
    parts = (spec.sphere, spec.plate, spec.contact)
    if spec.plate.mode_table is None or spec.plate.solid or is_rigid(spec.plate):
        return None
    if spec.frequency_limit_hz <= least_limit_hz(*parts, spec.frequency_limit_hz):
        return expected_error(*parts, spec.frequency_limit_hz, spring=True, damped=spec.damped_tail)
    if f.beyond_m_n != 0.0:
        return None
    rise = rigid_impact(spec.sphere, spec.contact).rise
    return min(1.0, beyond_m_n(spec.plate) * spec.contact.stiffness * rise)


def _modes_end_words(f: Facts, x: float) -> str:
    spec, last_hz = f.spec, f.spec.frequency_limit_hz
    lasts_s = rigid_impact(spec.sphere, spec.contact).contact_s
    ends = (
        f"the modes end at {last_hz:,.4g} Hz, and a contact of {1e6 * lasts_s:.3g} us reaches "
        f"{1.0 / lasts_s:,.3g} Hz: "
    )
    if spec.damped_tail:
        lost = energy_beyond(last_hz * lasts_s)
        return (
            f"{ends}an infinite plate stands for the rest. Peak force, rebound speed and plate "
            f"energy of the first impact are expected to be right within {percent(x)}, less so its "
            f"length; {percent(lost)} of the plate energy does not come back, so later impacts and "
            "vibration above the last mode are not known"
        )
    rest = f"a spring of {f.beyond_m_n:.3g} m/N" if f.beyond_m_n else "nothing"
    return (
        f"{ends}{rest} stands for the rest, so impacts may be off by {percent(x)}; trust vibration "
        "below the last mode only. Give plate.thickness_m if it is a plate (are the modes in Hz?)"
    )


def _clipped(f: Facts) -> float | None:
    """Largest force of the actuator over its limit."""
    if f.run.actuator_n == 0.0:
        return None
    limit = f.spec.actuator.force_limit_n
    return math.nan if limit is None else f.run.actuator_n / limit


def _actuator_mass(f: Facts) -> float | None:
    mass = f.spec.actuator.mass_kg
    if not mass:
        return math.nan if f.setup.has_law else None
    return math.nan if f.local is None else mass / f.mass_that_matters_kg


def _flight(f: Facts) -> float | None:
    """How far the law looks above the plate, over the range of the sensor there."""
    limits = f.setup.sensor.full_scale
    if f.setup.quantity != "xi" or not f.setup.has_law or limits is None:
        return None
    flight_m = f.flight_m()
    if flight_m == 0.0:
        return None
    return flight_m / limits[1] if limits[1] > 0.0 else math.inf


def _damped_tail(f: Facts) -> float | None:
    damper, run = f.spec.contact.hunt_crossley_s_m, f.run
    if not damper:
        return None
    return criteria.tail_share(damper, f.standing.flexibility_m_n, run.force_n, run.contact_s)


def _of_ball(f: Facts, value: float) -> float | None:
    """A value that only a ball has."""
    return None if math.isnan(f.spec.sphere.ball_radius_m) else value


def _of_radius(f: Facts, value: float) -> float | None:
    """A value that takes the radius of what touches, which not every hammer tip tells."""
    return None if math.isnan(f.spec.sphere.radius_m) else value


def _unknown_theory(x: float) -> str:
    """What to say where the error of thin-plate theory is not known; "" where it is."""
    if not math.isnan(x):
        return ""
    return "the error of thin-plate theory is not known for an orthotropic plate"


def _of_solid(f: Facts) -> str:
    return "plate.theory" if f.spec.plate.solid else ""


ROWS = (
    EffectRow(
        "yield", "p_0 / (1.6 Y), p_0 = 3 F/(2 pi a^2)", 1.0, _fully_plastic,
        lambda f: _of_radius(f, 1.5 * f.pressure_pa / _first_yield_pa(f)),
        _yields,
        "peak contact pressure is {x:.2g} times first yield", "contact.plasticity",
        lambda f: "" if f.plasticity == "none" else f"contact.plasticity = '{f.plasticity}'",
    ),
    EffectRow(
        "contact against sphere", "a / R", 0.1, 0.3,
        lambda f: _of_radius(f, f.radius_m / f.spec.sphere.radius_m),
        lambda f, x: (
            f"the contact is {x:.2g} of the radius of the {f.spec.sphere.touches} wide: Hertz's "
            f"law, a parabola on a flat, is off by about {percent(x * x)}"
        ),
        "contact radius is {x:.2g} of the radius that touches",
    ),
    EffectRow(
        "contact against plate", "a / h", 0.25, 0.5,
        lambda f: _of_radius(f, f.radius_m / f.spec.local_plate.thickness_m),
        lambda f, x: (
            "the plate is too thin for Hertz's law, which assumes a half space: the contact radius "
            f"is {x:.2g} of the thickness"
        ),
        "contact radius is {x:.2g} of the plate thickness", of_plate=True,
    ),
    EffectRow(
        "plate theory (energy)", "0.085 (k h)^2 at 1/T, where lambda < 1", None, 0.1,
        lambda f: f.kirchhoff.plate_energy if f.standing.zener < _TAKES_ALL else None,
        lambda f, x: _unknown_theory(x) or (
            "the waves are short against the plate thickness, k h = "
            f"{thickness_number(f.spec.local_plate, f.run.contact_s):.2g} at 1/T: Kirchhoff's "
            f"plate may take {percent(x)} less energy than an elastic solid, and the rebound be "
            f"off by {percent(f.kirchhoff.rebound_speed)} of the impact speed (requested: "
            f"{percent(f.setup.accuracy)}); plate.theory = '3d' models it"
        ),
        "energy error of thin-plate theory is {p}", "plate.theory", _of_solid, of_plate=True,
    ),
    EffectRow(
        "plate theory (peak)", "dC 3/2 s^(2/3) F^(1/3)", None, 0.5,
        lambda f: f.kirchhoff.peak_force,
        lambda f, x: _unknown_theory(x) or (
            "near the force an elastic solid deforms differently from Kirchhoff's plate with "
            f"Hertz's half space: peak force and contact time may be off by {percent(x)} "
            f"(requested: {percent(f.setup.accuracy)})"
        ),
        "peak-force error of thin-plate theory is {p}", "plate.theory", _of_solid, of_plate=True,
    ),
    EffectRow(
        "large deflection", "w_max / h", 0.2, 1.0,
        lambda f: f.run.deflection_m / f.spec.local_plate.thickness_m,
        lambda f, x: (
            f"the plate deflects by {1e3 * f.run.deflection_m:.2g} mm, {x:.2g} of its thickness: a "
            f"real one is stiffer, by up to {percent(x * x)} where its edges are held in the plane"
        ),
        "deflection is {x:.2g} of the plate thickness", of_plate=True,
    ),
    EffectRow(
        "vibration of the sphere", "T 2.65 c_T/(2 pi R)", 3.0, 1.0,
        lambda f: _of_ball(f, f.sphere_periods),
        lambda f, x: (
            f"the contact lasts {x:.2g} periods of the sphere's lowest vibration, which a rigid "
            "mass behind Hertz's spring does not have"
        ),
        "contact lasts {x:.2g} vibration periods of the sphere", falls=True,
    ),
    EffectRow(
        "thickness resonance", "T c_T/(2 h)", 3.0, 1.0,
        lambda f: f.thickness_periods,
        lambda f, x: (
            f"the plate is too thick for thin-plate theory: the contact lasts {x:.2g} periods of "
            "the first resonance through the thickness"
        ),
        "contact lasts {x:.2g} periods through the thickness", "", _of_solid,
        falls=True, of_plate=True,
    ),
    EffectRow(
        "reflections", "time after the touch / first return", 1.0, 10.0,
        lambda f: f.after_touch_s / f.first_return_s,
        lambda f, x: (
            f"bending waves are back from the edge after {1e6 * f.first_return_s:.3g} us, the "
            f"run goes on for {1e6 * f.after_touch_s:.3g} us, and an infinite plate has no edge"
        ),
        "run lasts {x:.2g} times the wave return time", "run.plate_model", _reflections,
    ),
    EffectRow(
        "delay of the loop", "(latency + 1 step + 2 zeta/omega_n + sensor) / T", 0.1, math.nan,
        lambda f: f.delay_s / f.run.contact_s if f.setup.has_law else None,
        lambda f, x: (
            f"the delay from sample to force is {1e6 * f.delay_s:.3g} us, {percent(x)} of the "
            "contact: most laws tolerate about a tenth"
            + ("; the actuator has no delay here" if f.spec.actuator.bandwidth_hz is None else "")
        ),
        "loop delay is {p} of the contact time",
    ),
    EffectRow(
        "force of the actuator", "max F_a / actuator.force_limit_n", 0.999, math.nan, _clipped,
        lambda f, x: (
            "the actuator has no force limit here; the law uses "
            f"{f.run.actuator_n:.3g} N" if math.isnan(x) else
            f"the actuator reaches its largest force, {f.run.actuator_n:.3g} N: the law may want "
            "more"
        ),
    ),
    EffectRow(
        "mass of the actuator", "m_a / min(0.05 m_s, 0.05 Z T/(2 pi))", 1.0, math.nan,
        _actuator_mass,
        lambda f, x: (
            "no mass of the actuator moves with the plate here; from "
            f"{1e3 * f.mass_that_matters_kg:.2g} g on it would matter (actuator.mass_kg)"
            if f.local else
            "no mass of the actuator moves with the structure here (actuator.mass_kg)"
        ),
        modelled=lambda f: "actuator.mass_kg" if f.spec.actuator.mass_kg else "",
    ),
    EffectRow(
        "air on the modes", "rho0 c/(omega m'' eta), one face", 0.1, math.nan,
        lambda f: f.standing.air_share,
        lambda f, x: (
            "how much air damps the modes is computed for thin plates only" if math.isnan(x) else
            f"air damps the modes above coincidence {x:.2g} times as much as the plate itself "
            "does: waves that return after milliseconds are weaker than computed; plate.radiation "
            "models it"
        ),
        "air damping is {x:.2g} times plate damping", "plate.radiation",
        lambda f: "plate.radiation" if f.spec.radiating_faces else "",
    ),
    EffectRow(
        "squeezed air film", "6 pi mu R^2 ln(R/1e-7 m) v/(m v^2/2)", 1e-3, 0.1,
        lambda f: _of_ball(f, f.standing.squeezed_film),
        lambda f, x: f"the film of air below the sphere takes {percent(x)} of its energy",
        "air film takes {p} of the energy",
    ),
    EffectRow(
        "drag on the drop", "3/8 C_D rho0 H/(rho_s R)", 1e-3, 0.1,
        lambda f: _of_ball(f, f.standing.drag),
        lambda f, x: f"drag takes {percent(x)} of the energy of the fall",
        "drag takes {p} of the fall energy",
    ),
    EffectRow(
        "range of the sensor", "v (latency + window) / range above the plate", 1.0, math.nan,
        _flight,
        lambda f, x: (
            f"the law looks {1e6 * f.flight_m():.3g} um above the plate, {x:.2g} times as far as "
            "the sensor's range goes (sensors.full_scale)"
        ),
        "law needs {x:.2g} times the sensor range", "sensors.full_scale",
    ),
    EffectRow(
        "damper behind a spring", "2.5 d R_0 F/T", None, 0.1, _damped_tail,
        lambda f, x: (
            "the contact damper ignores the deflection rate of the truncated modes: "
            f"plate energy may be off by {percent(x)} (requested: {percent(f.setup.accuracy)})"
        ),
        "energy error of contact damping is {p}", "",
        lambda f: "plate.tail, a damped mode" if f.spec.damped_tail else "",
    ),
    EffectRow(
        "modes end below the impact", "expected error of the first impact", None, _NOTHING_LEFT,
        _modes_end, _modes_end_words,
        "the modes end below the impact: its figures are within {p}, later ones unknown",
        "plate.tail",
    ),
    EffectRow(
        "edge refocusing", "time after the touch / revival of a square plate", 1.0, math.nan,
        lambda f: f.after_touch_s / f.standing.revival_s if f.standing.revival_s else None,
        lambda f, x: (
            f"every {1e3 * f.standing.revival_s:.3g} ms all modes of this square plate come back "
            "in phase, unlike those of a real plate: use the largest plate speed per contact, not "
            "per run"
        ),
        "the modes of a square plate return in phase during the run",
    ),
)  # fmt: skip
OF_PLATE = tuple(row.name for row in ROWS if row.of_plate)
_WITHOUT_PLATE = tuple(row for row in ROWS if not row.of_plate)


@dataclass(frozen=True)
class Neglected:
    """Every effect that there is something to say of in a run, and what they were computed from;
    none of a loop that is not `stable`."""

    facts: Facts | None
    findings: Sequence[Finding] = ()
    stable: bool = True


def neglected(setup: Setup, run: Extremes) -> Neglected:
    """All effects in a run."""
    facts = Facts(setup, run)
    found = [
        Finding(row.name, row.formula, value, threshold, beyond, state,
                f"in the model: {part}" if part else row.words(facts, value))
        for row, value, threshold, beyond, part, state in _evaluated(facts)
    ]  # fmt: skip
    return Neglected(facts, found)


def neglected_of_scene(setup: Setup) -> Neglected:
    """The same of a scene, simulated here, the beginning of a very long one."""
    setup = setup.with_steps(min(setup.steps, _MOST_STEPS))
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
    """Names of the effects in each state, as the results of a sweep have them."""
    names: dict[EffectState, list[str]] = {}
    for row, *_, state in _evaluated(facts):
        names.setdefault(state, []).append(row.name)
    return {state: ", ".join(some) for state, some in names.items()}


def _evaluated(
    facts: Facts,
) -> Iterator[tuple[EffectRow, float, float, float, str, EffectState]]:
    """Rows that say something: value, threshold, where out of range begins, what models it."""
    if not facts.touched:
        return
    for row in ROWS if facts.local else _WITHOUT_PLATE:
        value = row.value(facts)
        if value is None:
            continue
        threshold = facts.setup.accuracy if row.threshold is None else row.threshold
        beyond = row.beyond(facts) if callable(row.beyond) else row.beyond
        part = row.modelled(facts) if row.modelled is not None else ""
        if part:
            state = _IN_THE_MODEL
        elif value != value:
            state = _NOT_KNOWN
        elif value < beyond if row.falls else value > beyond:
            state = _OUT_OF_RANGE
        elif value < threshold if row.falls else value > threshold:
            state = _LEFT_OUT
        else:
            state = _WITHIN
        yield row, value, threshold, beyond, part, state


def percent(share: float) -> str:
    """A share with the two digits that an estimate has."""
    return f"{100.0 * share:{'.0f' if 0.995 <= share < 10.0 else '.2g'}} %"


def pressure(pascal: float) -> str:
    """A pressure in words."""
    return f"{pascal * 1e-9:.3g} GPa" if pascal >= 1e8 else f"{pascal * 1e-6:.3g} MPa"


def time_words(us: float) -> str:
    """A time to two digits."""
    for unit, length in (("s", 1e6), ("ms", 1e3)):
        if us >= length:
            return f"{float(f'{us / length:.2g}'):g} {unit}"
    return f"{float(f'{us:.2g}'):g} us"
