"""What the validity of a model is judged from: a setup and the largest values of its run."""

import math

from hertzloop.plant.estimates import criteria
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
        line_s = setup.run.step_s * (1 + setup.signal_path.dead_steps) + 1e-6 * setup.latency_us
        self.delay_s = line_s + self.spec.actuator.delay_s + setup.sensor.low_pass_delay_s
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
