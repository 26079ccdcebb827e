"""One impact with the metrics of the published study."""

import math

import numpy as np

from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise, PublishedContact, published_noise
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_C, XI
from hertzloop.scene.setup import Setup

_GREEN_STEPS = 1 << 17  # Green's functions of longer runs are sampled as far as a contact needs


def published_impact(
    setup: Setup, truth: np.ndarray, start: int, impact_speed_m_s: float
) -> tuple[Impact, ImpactNoise, np.ndarray, float]:
    """Return one impact by the study's definitions: over the samples of the contact and the first
    one after it.

    Args:
        setup: The setup of the run.
        truth: Steps of the contact and the one after it, if there is one, shape (10, steps).
        start: First step of the contact.
        impact_speed_m_s: Speed of the sphere before it.

    Returns:
        The impact, its noise metrics, the elastic force in contact (N), and the speed of the next
        impact (m/s).
    """
    from hertzloop.plant.schemes.thesis2008 import relative_speed_m_s, sampled  # seldom: 1 ms

    v0, spec, h = impact_speed_m_s, setup.plant, setup.run.step_s
    xi, f_a, f_c = truth[[XI, F_A, F_C]]
    touched = len(xi) - int(xi[-1] > 0.0)
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
        start_s=start * h,
        duration_s=noise.contact_time_s,
        impact_speed_m_s=v0,
        rebound_speed_m_s=noise.next_impact_speed_m_s,
        peak_force_n=float(f_c[:touched].max()),
        plate_energy_j=noise.transmitted_j,
        plate_speed_max_m_s=noise.plate_speed_max_m_s,
    )
    fall = 2.0 * GRAVITY_M_S2 * max(float(xi[-1]), 0.0)
    speed = noise.next_impact_speed_m_s  # of a loop that explodes its square may be infinite
    return impact, noise, elastic[:touched], math.sqrt(speed * speed + fall)
