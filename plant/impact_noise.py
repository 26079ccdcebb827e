"""All noise figures of one impact, put together from its rows."""

from functools import lru_cache

import numpy as np

from plant import noise
from plant.contact import Sphere
from plant.noise import ImpactNoise
from plant.plate import Oscillators, Plate, oscillators


def impact_noise(
    sphere: Sphere,
    plate: Plate,
    modes: Oscillators,
    contact_n: np.ndarray,
    actuator_n: np.ndarray,
    slope_n: np.ndarray,
    work_j: float,
    plate_speed_m_s: np.ndarray,
    step_s: float,
    contact_time_s: float,
    impact_speed_m_s: float,
    rebound_speed_m_s: float,
) -> ImpactNoise:
    """Figures of an impact of the consistent scheme.

    Forces up on the plate at the contact (-F_c, its change over a step -F_c1) and the
    actuator (F_a) from the contact's start to the next one's, `work_j` their work on the plate,
    `plate_speed_m_s`: at the struck point over the same steps.
    """
    shares = noise.modal_shares_j(plate, modes, contact_n, actuator_n, step_s, slope_n)
    frequency = modes.omega / (2.0 * np.pi)
    return ImpactNoise(
        **noise.closed_forms(sphere.radius_m, contact_time_s, impact_speed_m_s, rebound_speed_m_s),
        transmitted_j=work_j,
        transmitted_spectrum_j=float(np.sum(shares)),
        plate_speed_max_m_s=float(np.max(np.abs(plate_speed_m_s), initial=0.0)),
        radiated_j=noise.radiated_shares_j(
            plate, modes, shares, noise.radiation_efficiency(plate, frequency)
        ),
        radiated_maidanik_j=noise.radiated_shares_j(
            plate, modes, shares, noise.radiation_efficiency_maidanik(plate, frequency)
        ),
    )


@lru_cache(maxsize=8)
def _audible(
    plate: Plate, point_m: tuple[float, float], omega_max: float, length: int, step_s: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Re Y and both radiation efficiencies on the bins of the published sum."""
    modes = oscillators(plate, point_m, point_m, omega_max)
    bins = noise.audible_bins_hz(length, step_s)
    efficiencies = [
        noise.radiation_efficiency(plate, bins),
        noise.radiation_efficiency_maidanik(plate, bins),
    ]
    return noise.mobility(plate, modes, bins).real, efficiencies


def published_noise(
    sphere: Sphere,
    plate: Plate,
    modes: Oscillators,
    point_m: tuple[float, float],
    green_v: np.ndarray,
    elastic_n: np.ndarray,
    f_a: np.ndarray,
    step_s: float,
    impact_speed_m_s: float,
    relative_speed_m_s: float,
) -> ImpactNoise:
    """Figures of an impact as the published study formed them.

    `elastic_n` (contact force without damping) and `f_a` from the sample of the start to the
    first one after the end, `relative_speed_m_s` there. F = -F_c + F_a without damping; v_p
    the sampled convolution with `green_v` from t = 0 on; the contact time counts one step more
    than there are samples, as published.
    """
    force = f_a - elastic_n
    speed = step_s * np.convolve(green_v[: len(force)], force)[: len(force)]
    rebound = relative_speed_m_s + float(speed[-1])
    time_s = (len(force) + 1) * step_s
    shares = noise.modal_shares_j(plate, modes, -elastic_n, f_a, step_s)
    length = noise.fft_length(len(force))
    real, efficiencies = _audible(plate, point_m, float(np.pi / step_s), length, step_s)
    radiated, maidanik = noise.binned_energies_j(force, step_s, real, efficiencies)
    return ImpactNoise(
        **noise.closed_forms(sphere.radius_m, time_s, impact_speed_m_s, rebound),
        transmitted_j=float(np.sum(force * speed)) * step_s,
        transmitted_spectrum_j=float(np.sum(shares)),
        plate_speed_max_m_s=float(np.max(np.abs(speed))),
        radiated_j=radiated,
        radiated_maidanik_j=maidanik,
    )
