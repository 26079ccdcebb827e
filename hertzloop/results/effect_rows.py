"""The effects that a model may neglect, one row each, and what a run is judged from.

Sources are with the formulas, in hertzloop.plant.estimates.criteria.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from hertzloop.common.readable import percent, quantity
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.estimates import criteria
from hertzloop.plant.estimates.criteria import thickness_number
from hertzloop.plant.estimates.model_order import (
    beyond_m_n,
    energy_beyond,
    expected_error,
    is_rigid,
    least_limit_hz,
)
from hertzloop.results.statistics import Extremes
from hertzloop.scene.controller import law_flight_m
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_DIGITS = 3  # of length and force, for what takes an integral that is kept


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


class RunContext:
    """What an effect is evaluated from: a setup and the largest values of its run.

    Quantities that are not known are nan or None. `end_s`: end of the evaluated time, s; by default
    the end of the run.
    """

    def __init__(self, setup: Setup, run: Extremes, end_s: float | None = None) -> None:
        self.setup, self.run, self.spec = setup, run, setup.plant
        lasts_s, peak_n = _short(run.contact_s), _short(run.force_n)
        # From a sample to the force that it causes.
        path_s = setup.run.step_s * (1 + setup.signal_path.dead_steps) + 1e-6 * setup.latency_us
        self.delay_s = path_s + self.spec.actuator.delay_s + setup.sensor.low_pass_delay_s
        # The plate at the contact point, None for another structure; the body that yields first,
        # and its strength.
        self.local, self.weaker = self.spec.plate.local_plate, setup.mechanics.weaker
        self.end_s = setup.run.duration_s if end_s is None else end_s
        self.after_touch_s = self.end_s - run.touched_s
        self.touched = run.force_n > 0.0 and run.contact_s > 0.0
        if not self.touched:  # without a contact, no effect applies
            return
        contact, sphere, radius_m = self.spec.contact, self.spec.sphere, self.spec.sphere.radius_m
        # Radius, m, and mean pressure, Pa, at the largest force by Hertz.
        self.radius_m = criteria.contact_radius_m(run.force_n, radius_m, contact.stiffness)
        self.pressure_pa = criteria.mean_pressure_pa(run.force_n, self.radius_m)
        self.sphere_periods = criteria.sphere_periods(sphere, run.contact_s)
        self.first_return_s = math.nan  # of bending waves from an edge, s
        if self.local is None:
            return
        self.zener = criteria.zener_inelasticity(sphere, self.local, contact)
        if setup.scene.plate.size_m is not None and self.spec.plate.mode_table is None:
            self.first_return_s = criteria.first_return_s(
                self.local, setup.scene.plate.size_m, self.spec.contact_point_m, run.contact_s
            )
        self.thin_plate = criteria.thin_plate_error(self.local, contact.stiffness, lasts_s, peak_n)
        self.mass_that_matters_kg = criteria.mass_that_matters_kg(sphere, self.local, run.contact_s)

    @property
    def air_share(self) -> float:
        """Loss factor by air over that of the plate; nan where no closed form gives the modes."""
        if self.local is None or self.spec.plate.mode_table is not None:
            return math.nan
        air = criteria.air_loss_factor(self.local)
        return air / self.local.eta if self.local.eta else math.inf

    @property
    def beyond_m_n(self) -> float:
        """Flexibility that stands for the modes beyond the limit, m/N."""
        return self.spec.plate.residual_flexibility_m_n(
            2.0 * math.pi * self.spec.frequency_limit_hz
        )

    @property
    def plasticity(self) -> str:
        """How the contact yields, "none" if it does not."""
        return "none" if self.spec.contact.limit is None else "thornton"

    def flight_m(self) -> float:
        """How far above the plate the law looks, m; zero of one that waits for the contact."""
        try:
            return law_flight_m(self.setup)
        except SceneError:  # a recording may outlive its law
            return 0.0


_TAKES_ALL = 1.0  # lambda from which on the plate takes all energy, whatever its theory

_NOTHING_LEFT = 0.5  # expected error from which on a first impact is not to be trusted


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
    beyond: float | Callable[[RunContext], float]
    value: Callable[[RunContext], float | None]
    words: Callable[[RunContext, float], str]
    brief: str = ""
    key: str = ""
    modelled: Callable[[RunContext], str] | None = None
    falls: bool = False
    of_plate: bool = False


def _first_yield_pa(f: RunContext) -> float:
    return f.weaker[1].first_yield_pa if f.weaker else math.nan


def _fully_plastic(f: RunContext) -> float:
    """Centre pressure over that of first yield, where the mean pressure is the hardness."""
    weaker = f.weaker
    return 1.5 * weaker[1].pressure_pa / weaker[1].first_yield_pa if weaker else math.nan


def _yields(f: RunContext, x: float) -> str:
    if f.weaker is None or math.isnan(x):
        return (
            "whether the plate yields; its contact is elastic here. Give plate.material.yield_pa "
            "or hardness_pa, or a material that has them, such as steel_s235"
        )
    body, strength = f.weaker
    words = (
        f"the {body} yields: mean pressure {quantity(f.pressure_pa, 'Pa')}, "
        f"{quantity(1.5 * f.pressure_pa, 'Pa')} in the centre, where yield begins at "
        f"{quantity(strength.first_yield_pa, 'Pa')}"
    )
    if f.pressure_pa > strength.pressure_pa:
        words += f" and is full at a mean of {quantity(strength.pressure_pa, 'Pa')}"
    return f"{words}; contact.plasticity = 'thornton' models it"


def _reflections(f: RunContext) -> str:
    """In the model unless the plate has no edges, and that costs more than is asked for."""
    missed = f.spec.infinite_plate and not (
        f.setup.infinite_plate.error(f.end_s - f.setup.first_touch_s) <= f.setup.run.accuracy
    )
    return "" if missed else "reflections, as far as they are asked for"


def _modes_end(f: RunContext) -> float | None:
    """Expected error of modes that are known to below the impact only, or beyond which there is
    nothing."""
    spec = f.spec
    parts = (spec.sphere, spec.plate, spec.contact)
    if spec.plate.highest_hz == math.inf or is_rigid(spec.plate):
        return None
    if spec.frequency_limit_hz <= least_limit_hz(*parts, spec.frequency_limit_hz):
        return expected_error(
            *parts, spec.frequency_limit_hz, spring=True, damped=spec.damped_residual
        )
    if f.beyond_m_n != 0.0:
        return None
    rise = rigid_impact(spec.sphere, spec.contact).rise
    return min(1.0, beyond_m_n(spec.plate) * spec.contact.stiffness * rise)


def _modes_end_words(f: RunContext, x: float) -> str:
    spec, last_hz = f.spec, f.spec.frequency_limit_hz
    lasts_s = rigid_impact(spec.sphere, spec.contact).contact_s
    ends = (
        f"the modes end at {last_hz:,.4g} Hz, and a contact of {1e6 * lasts_s:.3g} us reaches "
        f"{1.0 / lasts_s:,.3g} Hz: "
    )
    if spec.damped_residual:
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
        "below the last mode only."
        + (
            " Give plate.thickness_m if it is a plate (are the modes in Hz?)"
            if spec.plate.mode_table is not None
            else ""
        )
    )


def _clipped(f: RunContext) -> float | None:
    """Largest commanded force of the actuator over its limit."""
    if f.run.actuator_n == 0.0:
        return None
    limit = f.spec.actuator.force_limit_n
    return math.nan if limit is None else f.run.actuator_n / limit


def _actuator_mass(f: RunContext) -> float | None:
    mass = f.spec.actuator.mass_kg
    if not mass:
        return math.nan if f.setup.scene.controller.has_law else None
    return math.nan if f.local is None else mass / f.mass_that_matters_kg


def _flight(f: RunContext) -> float | None:
    """How far the law looks above the plate, over the range of the sensor there."""
    limits = f.setup.sensor.full_scale
    if (
        f.setup.scene.sensors.quantity != "xi"
        or not f.setup.scene.controller.has_law
        or limits is None
    ):
        return None
    flight_m = f.flight_m()
    if flight_m == 0.0:
        return None
    return flight_m / limits[1] if limits[1] > 0.0 else math.inf


ROWS = (
    EffectRow(
        "yield", "p_0 / (1.6 Y), p_0 = 3 F/(2 pi a^2)", 1.0, _fully_plastic,
        lambda f: 1.5 * f.pressure_pa / _first_yield_pa(f),
        _yields,
        "peak contact pressure is {x:.2g} times first yield", "contact.plasticity",
        lambda f: "" if f.plasticity == "none" else f"contact.plasticity = '{f.plasticity}'",
    ),
    EffectRow(
        "contact against sphere", "a / R", 0.1, 0.3,
        lambda f: f.radius_m / f.spec.sphere.radius_m,
        lambda f, x: (
            f"the contact is {x:.2g} of the radius of the sphere wide: Hertz's "
            f"law, a parabola on a flat, is off by about {percent(x * x)}"
        ),
        "contact radius is {x:.2g} of the radius that touches",
    ),
    EffectRow(
        "contact against plate", "a / h", 0.25, 0.5,
        lambda f: f.radius_m / f.spec.local_plate.thickness_m,
        lambda f, x: (
            "the plate is too thin for Hertz's law, which assumes a half space: the contact radius "
            f"is {x:.2g} of the thickness"
        ),
        "contact radius is {x:.2g} of the plate thickness", of_plate=True,
    ),
    EffectRow(
        "plate theory (energy)", "0.085 (k h)^2 at 1/T, where lambda < 1", None, 0.1,
        lambda f: f.thin_plate.plate_energy if f.zener < _TAKES_ALL else None,
        lambda f, x: (
            "the waves are short against the plate thickness, k h = "
            f"{thickness_number(f.spec.local_plate, f.run.contact_s):.2g} at 1/T: Kirchhoff's "
            f"plate may take {percent(x)} less energy than an elastic solid, and the rebound be "
            f"off by {percent(f.thin_plate.rebound_speed)} of the impact speed (requested: "
            f"{percent(f.setup.run.accuracy)})"
        ),
        "energy error of thin-plate theory is {p}", of_plate=True,
    ),
    EffectRow(
        "plate theory (peak)", "dC 3/2 s^(2/3) F^(1/3)", None, 0.5,
        lambda f: f.thin_plate.peak_force,
        lambda f, x: (
            "near the force an elastic solid deforms differently from Kirchhoff's plate with "
            f"Hertz's half space: peak force and contact time may be off by {percent(x)} "
            f"(requested: {percent(f.setup.run.accuracy)})"
        ),
        "peak-force error of thin-plate theory is {p}", of_plate=True,
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
        lambda f: f.sphere_periods,
        lambda f, x: (
            f"the contact lasts {x:.2g} periods of the sphere's lowest vibration, which a rigid "
            "mass behind Hertz's spring does not have"
        ),
        "contact lasts {x:.2g} vibration periods of the sphere", falls=True,
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
        lambda f: f.delay_s / f.run.contact_s if f.setup.scene.controller.has_law else None,
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
        lambda f: f.air_share,
        lambda f, x: (
            "how much air damps the modes is computed for thin plates only" if math.isnan(x) else
            f"air damps the modes above coincidence {x:.2g} times as much as the plate itself "
            "does: waves that return after milliseconds are weaker than computed; "
            "plate.loss_factor can hold that of the air as well"
        ),
        "air damping is {x:.2g} times plate damping", "plate.loss_factor",
    ),
    EffectRow(
        "air around the sphere", "film: 6 pi mu R^2 ln(R/1e-7 m) v/(m v^2/2), drag: 3/8 C_D rho0 H/"
        "(rho_s R)", 1e-3, 0.1,
        lambda f: criteria.squeezed_film(f.spec.sphere) + criteria.drag_on_the_drop(f.spec.sphere),
        lambda f, x: f"drag in the fall and the film of air below the sphere take {percent(x)} of "
        "its energy",
        "air takes {p} of the sphere's energy",
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
        "modes end below the impact", "expected error of the first impact", None, _NOTHING_LEFT,
        _modes_end, _modes_end_words,
        "the modes end below the impact: its metrics are within {p}, later ones unknown",
        "plate.tail",
    ),
)  # fmt: skip

OF_PLATE = tuple(row.name for row in ROWS if row.of_plate)

WITHOUT_PLATE = tuple(row for row in ROWS if not row.of_plate)
