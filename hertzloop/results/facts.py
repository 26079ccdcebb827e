"""What the indicators of hertzloop.results.validity are computed from: a scene and its extremes."""

import math
from dataclasses import dataclass
from functools import cached_property

from hertzloop.results.extremes import Extremes
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup
from plant.contact.hertz import Sphere
from plant.contact.yielding import Strength
from plant.estimates import criteria
from plant.estimates.plate_theory import KirchhoffError, kirchhoff_error, thickness_number
from plant.estimates.plate_theory import zener_inelasticity as inelasticity
from plant.plant import PlantSpec
from plant.schemes.collocation import flexibility_m_n
from plant.structures.plate import Plate

_SQUARE = 1e-3  # difference of the sides up to which a plate is square
_DIGITS = 3  # of length and force, for what takes an integral that is kept


def percent(share: float) -> str:
    """A share with the two digits that an estimate has."""
    return f"{100.0 * share:.2g} %"


def pressure(pascal: float) -> str:
    """A pressure in words."""
    return f"{pascal * 1e-9:.3g} GPa" if pascal >= 1e8 else f"{pascal * 1e-6:.3g} MPa"


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


@dataclass(frozen=True)
class Facts:
    """A scene, its plant and the largest values of its run; what is not known is nan."""

    setup: Setup
    spec: PlantSpec
    run: Extremes

    @property
    def sphere(self) -> Sphere:
        """The sphere."""
        return self.spec.sphere

    @property
    def local(self) -> Plate | None:
        """The plate at the struck point, if it is one."""
        return self.spec.plate.local_plate

    @property
    def accuracy(self) -> float:
        """What the scene asks for."""
        return self.setup.accuracy

    @property
    def thickness_m(self) -> float:
        """Of the plate, m."""
        return self.local.thickness_m if self.local else math.nan

    @cached_property
    def contact_radius_m(self) -> float:
        """At the largest force, by Hertz, m."""
        contact = self.spec.contact
        return criteria.contact_radius_m(self.run.force_n, self.sphere.radius_m, contact.stiffness)

    @cached_property
    def mean_pressure_pa(self) -> float:
        """At the largest force, by Hertz, Pa."""
        return criteria.mean_pressure_pa(self.run.force_n, self.contact_radius_m)

    @cached_property
    def weaker(self) -> tuple[str, Strength] | None:
        """Which body yields first, and its strength."""
        return self.setup.bodies.weaker

    @property
    def plasticity(self) -> str:
        """The key that lets the contact yield, if it does."""
        kind = self.setup.scene.contact.plasticity
        return "" if kind == "none" else f"contact.plasticity = '{kind}'"

    @property
    def centre_pressure_share(self) -> float:
        """Centre pressure over that of first yield."""
        if self.weaker is None:
            return math.nan
        return 1.5 * self.mean_pressure_pa / self.weaker[1].first_yield_pa

    @property
    def fully_plastic_share(self) -> float:
        """The same at which the mean pressure is the hardness."""
        if self.weaker is None:
            return math.nan
        return 1.5 * self.weaker[1].pressure_pa / self.weaker[1].first_yield_pa

    @property
    def kh(self) -> float:
        """Wave number of bending at 1/T times the thickness."""
        return thickness_number(self.local, self.run.contact_s) if self.local else math.nan

    @property
    def zener(self) -> float:
        """Zener's lambda."""
        if self.local is None:
            return math.nan
        return inelasticity(self.sphere, self.local, self.spec.contact)

    @cached_property
    def kirchhoff(self) -> KirchhoffError:
        """What Kirchhoff's theory may cost."""
        if self.local is None:
            return KirchhoffError(math.nan, math.nan, math.nan)
        return kirchhoff_error(
            self.local, self.spec.contact.stiffness, _short(self.run.contact_s),
            _short(self.run.force_n),
        )  # fmt: skip

    @property
    def after_touch_s(self) -> float:
        """From the first touch to the end of the run, s."""
        return self.setup.duration_s - self.run.touched_s

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
        return self.spec.infinite_plate and (not self.setup.infinite_plate_error <= self.accuracy)

    @cached_property
    def revival_s(self) -> float:
        """When a square plate's modes are in phase again, s; zero for what has no such time."""
        plate = self.spec.plate.separable
        if plate is None or self.spec.infinite_plate:
            return 0.0
        x, y = plate.size_m
        return criteria.revival_s(plate, x) if abs(x - y) <= _SQUARE * x else 0.0

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
    def solid(self) -> str:
        """The key that makes the plate an elastic solid, "" if it is none."""
        return "plate.theory" if self.spec.plate.solid else ""

    @property
    def air_share(self) -> float:
        """Loss factor by air over the plate's own."""
        plate = self.spec.plate
        if self.local is None or plate.solid or plate.mode_table is not None:
            return math.nan
        own = self.local.eta
        return criteria.air_loss_factor(self.local) / own if own else math.inf

    @cached_property
    def flight_m(self) -> float:
        """How far above the plate the law looks, m; zero of one that waits for the contact."""
        try:
            return self.setup.law_flight_m
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

    @property
    def flexibility_m_n(self) -> float:
        """The spring of the modes left out, m/N."""
        return flexibility_m_n(self.spec)
