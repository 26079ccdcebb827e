"""What a run leaves out: one row an indicator, evaluated from its largest force, the length of that
contact and the largest deflection.

A row has a name, the formula, a threshold, from where on it is beyond what the model can be (out
of range), and a sentence with the size. Sources are with the formulas, in
plant.estimates.criteria and plant.estimates.plate_theory.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from hertzloop.results.facts import Facts, percent, pressure
from plant.estimates import criteria

State = Literal["within", "left out", "out of range", "in the model", "not known"]
_TAKES_ALL = 1.0  # lambda from which on the plate takes all energy, whatever its theory


@dataclass(frozen=True)
class Finding:
    """An indicator of a run: `value` against `threshold` (nan where either is not known),
    `state`, and a sentence; `beyond` is where "out of range" begins, inf if nowhere."""

    name: str
    formula: str
    value: float
    threshold: float
    beyond: float
    state: State
    sentence: str


class Row(NamedTuple):
    """One indicator. `threshold` None: the accuracy that the scene asks for. `falls`: it is a least
    value and not a largest. `part`: what of the scene puts the effect into the model, or "".
    `value` is nan where it is not known, None where there is nothing to say."""

    name: str
    formula: str
    threshold: float | None
    beyond: float
    value: Callable[[Facts], float | None]
    words: Callable[[Facts, float], str]
    part: Callable[[Facts], str] = lambda f: ""
    falls: bool = False


def _yields(f: Facts, x: float) -> str:
    if f.weaker is None or math.isnan(x):
        return "when the plate yields is not known: give plate.material.yield_pa or hardness_pa"
    body, strength = f.weaker
    words = (
        f"the {body} yields: mean pressure {pressure(f.mean_pressure_pa)}, "
        f"{pressure(1.5 * f.mean_pressure_pa)} in the centre, where yield begins at "
        f"{pressure(strength.first_yield_pa)}"
    )
    if f.mean_pressure_pa > strength.pressure_pa:
        words += f" and is full at a mean of {pressure(strength.pressure_pa)}"
    return f"{words}; contact.plasticity = 'thornton' takes it in"


def _kirchhoff(f: Facts, x: float) -> str:
    return (
        f"waves are hardly longer than the plate is thick, k h = {f.kh:.2g} at 1/T: Kirchhoff's "
        f"plate may take {percent(x)} less energy than an elastic solid, and the rebound be off by "
        f"{percent(f.kirchhoff.rebound_speed)} of the impact speed (asked: "
        f"{percent(f.accuracy)}); plate.theory = '3d' takes it in"
    )


def _static(f: Facts, x: float) -> str:
    return (
        "near the force an elastic solid gives way otherwise than Kirchhoff's plate and Hertz's "
        f"half space together: peak force and contact time may be off by {percent(x)} (asked: "
        f"{percent(f.accuracy)})"
    )


def _delay(f: Facts, x: float) -> str:
    actuator = "" if f.has_bandwidth else "; the actuator has no delay here"
    return (
        f"from sample to force it takes {1e6 * f.delay_s:.3g} us, {percent(x)} of the contact: "
        f"most laws survive about a tenth{actuator}"
    )


ROWS = (
    Row(
        "yield", "p_0 / (1.6 Y), p_0 = 3 F/(2 pi a^2)", 1.0, math.nan,
        lambda f: f.centre_pressure_share, _yields, lambda f: f.plasticity,
    ),
    Row(
        "contact against sphere", "a / R", 0.1, 0.3,
        lambda f: f.contact_radius_m / f.sphere.radius_m,
        lambda f, x: f"the contact is {x:.2g} of the sphere's radius wide: Hertz's law, a parabola "
        f"on a flat, is off by about {percent(x * x)}",
    ),
    Row(
        "contact against plate", "a / h", 0.25, 0.5,
        lambda f: f.contact_radius_m / f.thickness_m,
        lambda f, x: f"the plate is thinner than its contact permits: the contact's radius is "
        f"{x:.2g} of the thickness, and Hertz's law counts on a half space below it",
    ),
    Row(
        "plate theory (energy)", "0.085 (k h)^2 at 1/T, where lambda < 1", None, 0.1,
        lambda f: f.kirchhoff.plate_energy if f.zener < _TAKES_ALL else None, _kirchhoff,
        lambda f: f.solid,
    ),
    Row(
        "plate theory (peak)", "dC 3/2 s^(2/3) F^(1/3)", None, 0.5,
        lambda f: f.kirchhoff.peak_force, _static, lambda f: f.solid,
    ),
    Row(
        "large deflection", "w_max / h", 0.2, 1.0,
        lambda f: f.run.deflection_m / f.thickness_m,
        lambda f, x: f"the plate deflects by {1e3 * f.run.deflection_m:.2g} mm, {x:.2g} of its "
        f"thickness: a real one is stiffer, by up to {percent(x * x)} where its edges are held in "
        "the plane",
    ),
    Row(
        "vibration of the sphere", "T 2.65 c_T/(2 pi R)", 3.0, 1.0,
        lambda f: criteria.sphere_periods(f.sphere, f.run.contact_s),
        lambda f, x: f"the contact lasts {x:.2g} periods of the sphere's lowest vibration, which a "
        "rigid mass behind Hertz's spring does not have",
        falls=True,
    ),
    Row(
        "thickness resonance", "T c_T/(2 h)", 3.0, 1.0,
        lambda f: criteria.thickness_periods(f.local, f.run.contact_s) if f.local else math.nan,
        lambda f, x: f"the plate is thicker than its contact permits: that lasts {x:.2g} periods "
        "of the first resonance through the thickness, which a thin plate does not have",
        falls=True,
    ),
    Row(
        "reflections", "time after the touch / first return", 1.0, 10.0,
        lambda f: f.after_touch_s / f.first_return_s,
        lambda f, x: f"bending waves are back from the edge after {1e6 * f.first_return_s:.3g} us, "
        f"the run goes on for {1e6 * f.after_touch_s:.3g} us, and an infinite plate has no edge",
        lambda f: "" if f.misses_reflections else "reflections, as far as they are asked for",
    ),
    Row(
        "delay of the loop", "(latency + 1 step + 2 zeta/omega_n + sensor) / T", 0.1, math.nan,
        lambda f: f.delay_s / f.run.contact_s if f.controlled else None, _delay,
    ),
    Row(
        "force of the actuator", "max F_a / actuator.force_limit_n", 0.999, math.nan,
        lambda f: f.clipped_share,
        lambda f, x: "the actuator has no largest force here; the law takes "
        f"{f.run.actuator_n:.3g} N" if math.isnan(x) else
        f"the actuator reaches its largest force, {f.run.actuator_n:.3g} N: the law may want more",
    ),
    Row(
        "mass of the actuator", "m_a / min(0.05 m_s, 0.05 Z T/(2 pi))", 1.0, math.nan,
        lambda f: f.actuator_mass_share,
        lambda f, x: "no mass of the actuator moves with the plate here; from "
        f"{1e3 * f.mass_that_matters_kg:.2g} g on it would matter (actuator.mass_kg)",
        lambda f: "actuator.mass_kg" if f.spec.actuator.mass_kg else "",
    ),
    Row(
        "air on the modes", "rho0 c/(omega m'' eta), one face", 0.1, math.nan,
        lambda f: f.air_share,
        lambda f, x: f"air damps the modes above coincidence {x:.2g} times as much as the plate "
        "itself does: what comes back after milliseconds is weaker than computed; plate.radiation "
        "takes it in",
        lambda f: "plate.radiation" if f.spec.radiating_faces else "",
    ),
    Row(
        "squeezed air film", "6 pi mu R^2 ln(R/1e-7 m) v/(m v^2/2)", 1e-3, 0.1,
        lambda f: criteria.squeezed_film(f.sphere),
        lambda f, x: f"the film of air below the sphere takes {percent(x)} of its energy",
    ),
    Row(
        "drag on the drop", "3/8 C_D rho0 H/(rho_s R)", 1e-3, 0.1,
        lambda f: criteria.drag_on_the_drop(f.sphere),
        lambda f, x: f"drag takes {percent(x)} of the energy of the fall",
    ),
    Row(
        "range of the sensor", "v (latency + window) / range above the plate", 1.0, math.nan,
        lambda f: f.flight_share,
        lambda f, x: f"the law looks {1e6 * f.flight_m:.3g} um above the plate, {x:.2g} times as "
        "far as the sensor's range goes (sensors.full_scale)",
    ),
    Row(
        "damper behind a spring", "2.5 d R_0 F/T", None, 0.1,
        lambda f: criteria.tail_share(
            f.spec.contact.hunt_crossley_s_m, f.flexibility_m_n, f.run.force_n, f.run.contact_s
        ) if f.spec.contact.hunt_crossley_s_m else None,
        lambda f, x: "the spring of the modes left out has a rate that the damper in the contact "
        f"does not feel: plate energy may be off by {percent(x)} (asked: {percent(f.accuracy)})",
        lambda f: "plate.tail, a damped mode" if f.spec.damped_tail else "",
    ),
    Row(
        "edge refocusing", "time after the touch / revival of a square plate", 1.0, math.nan,
        lambda f: f.after_touch_s / f.revival_s if f.revival_s else None,
        lambda f, x: f"every {1e3 * f.revival_s:.3g} ms all modes of this square plate come back "
        "in phase, which those of a real one do not: take the largest plate speed per contact, not "
        "per run",
    ),
)  # fmt: skip


class _Judged(NamedTuple):
    """What an indicator says about a run; `part`: what of the scene puts it into the model."""

    value: float
    threshold: float
    beyond: float
    part: str
    state: State


def findings(facts: Facts) -> list[Finding]:
    """Every indicator that says something about a run."""
    return [_in_words(row, facts, found) for row, found in _judged(facts)]


def names_by_state(facts: Facts) -> dict[State, str]:
    """Names of the indicators in each state, as the results of a sweep have them."""
    names: dict[State, list[str]] = {}
    for row, found in _judged(facts):
        names.setdefault(found.state, []).append(row.name)
    return {state: ", ".join(some) for state, some in names.items()}


def _judged(facts: Facts) -> Iterator[tuple[Row, _Judged]]:
    if not facts.run.force_n > 0.0 or not facts.run.contact_s > 0.0:
        return  # without a contact nothing is left out of it
    for row in ROWS:
        value = row.value(facts)
        if value is None:
            continue
        threshold = facts.accuracy if row.threshold is None else row.threshold
        beyond = facts.fully_plastic_share if row.name == "yield" else row.beyond
        part = row.part(facts)
        if part:
            state: State = "in the model"
        elif math.isnan(value):
            state = "not known"
        elif _exceeds(value, beyond, row.falls):
            state = "out of range"
        elif _exceeds(value, threshold, row.falls):
            state = "left out"
        else:
            state = "within"
        yield row, _Judged(value, threshold, beyond, part, state)


def _in_words(row: Row, facts: Facts, found: _Judged) -> Finding:
    value, threshold, beyond, part, state = found
    words = f"in the model: {part}" if part else row.words(facts, value)
    return Finding(row.name, row.formula, value, threshold, beyond, state, words)


def _exceeds(value: float, limit: float, falls: bool) -> bool:
    return value < limit if falls else value > limit


def warnings_of(found: list[Finding]) -> list[str]:
    """Sentences on what is out of range by far."""
    return [f"{f.name}: {f.sentence}" for f in found if f.state == "out of range"]
