"""All noise figures of one impact, put together from its rows."""

import math
from functools import lru_cache

import numpy as np

from plant.contact.hertz import Sphere
from plant.figures import noise
from plant.figures.noise import ImpactNoise
from plant.structures.plate import Oscillators, Plate, oscillators
from plant.structures.radiation import (
    Efficiency,
    air_loss_factor,
    efficiency,
    efficiency_fahy,
)
from plant.structures.solid_plate import SolidPlate
from plant.structures.structure import Structure

_EFFICIENCIES: dict[str, Efficiency] = {"": efficiency_fahy, "_maidanik": efficiency}


def impact_noise(
    sphere: Sphere,
    plate: Structure,
    modes: Oscillators,
    shares_j: np.ndarray,
    work_j: float,
    plate_speed_max_m_s: float,
    contact_time_s: float,
    impact_speed_m_s: float,
    rebound_speed_m_s: float,
    faces: int = 1,
) -> ImpactNoise:
    """Figures of an impact of the consistent scheme.

    `shares_j`: what every oscillator takes (see `noise.modal_shares_j`) of the forces at contact
    and actuator from the contact's start until the impact is over, `work_j` their work on the
    plate, `plate_speed_max_m_s`: the largest at the contact point over the same steps. Radiated
    energies are nan for any other structure than a simply supported plate, whose efficiencies are
    known. Without modes (`plant.NO_MODES`) all sums over modes are nan. `faces`: that radiate.
    """
    if isinstance(plate, SolidPlate):  # waves as short as sound are long in it
        plate = plate.plate
    return ImpactNoise(
        **noise.closed_forms(sphere.radius_m, contact_time_s, impact_speed_m_s, rebound_speed_m_s),
        transmitted_j=work_j,
        transmitted_spectrum_j=float(np.sum(shares_j)) if modes.modes else math.nan,
        plate_speed_max_m_s=plate_speed_max_m_s,
        **_radiated_j(plate, modes, shares_j, faces),
    )


def _radiated_j(
    plate: Structure, modes: Oscillators, shares_j: np.ndarray, faces: int
) -> dict[str, float]:
    """The study's sums of sigma E, and what the modes radiate of their energies E, by fields."""
    if not isinstance(plate, Plate) or not modes.modes:
        return dict.fromkeys(_RADIATED, math.nan)
    audible, weights = _weights(plate, modes, faces)
    sums = np.sum(shares_j[audible] * weights, axis=1)
    return dict(zip(_RADIATED, sums.tolist(), strict=True))


_RADIATED = [f"{kind}{name}_j" for kind in ("radiated", "sound") for name in _EFFICIENCIES]


@lru_cache(maxsize=16)
def _weights(plate: Plate, modes: Oscillators, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Oscillators up to 20 kHz, and what of their energies counts, for all impacts on a plate: a
    row for each of `_RADIATED`."""
    frequency = modes.omega / (2.0 * np.pi)
    audible = noise.audible(modes)
    weights = [by(plate, frequency)[audible] for by in _EFFICIENCIES.values()]
    for by in _EFFICIENCIES.values():
        air_eta = air_loss_factor(plate, frequency, faces, by)
        weights.append(noise.radiated_parts(plate.eta, air_eta)[audible])
    return audible, np.array(weights)


@lru_cache(maxsize=8)
def _audible(
    plate: Plate, point_m: tuple[float, float], omega_max: float, length: int, step_s: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Re Y and both radiation efficiencies on the bins of the published sum."""
    modes = oscillators(plate, point_m, point_m, omega_max)
    bins = noise.audible_bins_hz(length, step_s)
    efficiencies = [by(plate, bins) for by in _EFFICIENCIES.values()]
    return noise.mobility(modes, bins).real, efficiencies


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
    shares = noise.modal_shares_j(modes, -elastic_n, f_a, step_s)
    length = noise.fft_length(len(force))
    real, efficiencies = _audible(plate, point_m, float(np.pi / step_s), length, step_s)
    sounds = _radiated_j(plate, modes, shares, 1)
    radiated, maidanik = noise.binned_energies_j(force, step_s, real, efficiencies)
    return ImpactNoise(
        **noise.closed_forms(sphere.radius_m, time_s, impact_speed_m_s, rebound),
        transmitted_j=float(np.sum(force * speed)) * step_s,
        transmitted_spectrum_j=float(np.sum(shares)),
        plate_speed_max_m_s=float(np.max(np.abs(speed))),
        radiated_j=radiated,
        radiated_maidanik_j=maidanik,
        **{name: sounds[name] for name in sounds if name.startswith("sound")},
    )
