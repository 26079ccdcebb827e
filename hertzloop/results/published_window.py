"""One impact with the metrics of the published study."""

import math

import numpy as np

from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import PublishedContact, published_noise
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_C, XI
from hertzloop.results.impact_windows import ImpactMetrics
from hertzloop.scene.setup import Setup

_GREEN_STEPS = 1 << 17  # Green's functions of longer runs are sampled as far as a contact needs


class PublishedWindow:
    """The study's metrics: over the samples of the contact and the first one after.

    The last of `speeds` is the impact speed; the next one is appended.
    """

    def __init__(self, setup: Setup, speeds: list[float], start: int) -> None:
        self.setup, self.speeds, self.start = setup, speeds, start
        self._parts: list[np.ndarray] = []
        self._ended = False

    def feed(self, truth: np.ndarray) -> None:
        """Keep what belongs to the contact."""
        if self._ended:
            return
        apart = np.flatnonzero(truth[XI] > 0.0)
        self._ended = bool(len(apart))
        self._parts.append(truth[[XI, F_A, F_C], : apart[0] + 1 if len(apart) else None])

    def close(self, following: np.ndarray | None) -> ImpactMetrics:
        """See ImpactWindow."""
        from hertzloop.plant.schemes.thesis2008 import relative_speed_m_s, sampled  # seldom: 1 ms

        setup, v0 = self.setup, self.speeds[-1]
        spec, h = setup.plant, setup.run.step_s
        xi, f_a, f_c = np.concatenate(self._parts, axis=1)
        touched = len(xi) - self._ended
        known = setup.run.steps if setup.run.steps <= _GREEN_STEPS else len(xi)
        modes, (_, green_v, _) = sampled(
            spec.simply_supported, spec.contact_point_m, h, max(known, len(xi)) + 2
        )
        elastic = spec.contact.stiffness * np.maximum(-xi, 0.0) ** 1.5
        noise = published_noise(
            spec.sphere,
            spec.simply_supported,
            modes,
            spec.contact_point_m,
            green_v,
            PublishedContact(elastic, f_a, h, v0, relative_speed_m_s(xi, v0, h)),
        )
        impact = Impact(
            start_s=self.start * h,
            duration_s=noise.contact_time_s,
            impact_speed_m_s=v0,
            rebound_speed_m_s=noise.next_impact_speed_m_s,
            peak_force_n=float(f_c[:touched].max()),
            plate_energy_j=noise.transmitted_j,
            plate_speed_max_m_s=noise.plate_speed_max_m_s,
        )
        fall = 2.0 * GRAVITY_M_S2 * max(float(xi[-1]), 0.0)
        speed = noise.next_impact_speed_m_s  # of a loop that explodes its square may be infinite
        self.speeds.append(math.sqrt(speed * speed + fall))
        end = self.start + touched
        return ImpactMetrics(self.start, end, end, elastic[:touched], self._ended, impact, noise)
