"""Noise and vibration metrics of an impact, as pure functions.

Forces are those on the plate, up positive: F = -F_c + F_a (N), one value a step, held over
the step. Spectra follow F(w) = integral F(t) exp(-i w t) dt (N s).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.hertz import Sphere
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.radiation import (
    AIR_DENSITY_KG_M3,
    SOUND_SPEED_M_S,
    Efficiency,
    air_loss_factor,
    efficiency,
    efficiency_fahy,
    radiated_parts,
)
from hertzloop.plant.structures.structure import oscillators

RADIATED_UP_TO_HZ = 20e3
_FASTEST_M_S = 1e100
_FFT_LENGTH = 1 << 16  # least length of the published sums over frequency, zeros appended
_EFFICIENCIES: dict[str, Efficiency] = {"": efficiency_fahy, "_maidanik": efficiency}


@dataclass(frozen=True)
class ImpactNoise:
    """Noise metrics of one impact.

    The functions of this module define each metric. Radiated energies are summed up to 20 kHz,
    with the efficiency of eq. 3.12 (Fahy) or of eq. 3.13 (Maidanik 1962).

    Attributes:
        contact_time_s: contact time, s.
        impact_speed_m_s: speed of the sphere before, m/s.
        next_impact_speed_m_s: speed of the sphere at its next impact, m/s.
        rebound_height_m: height of the sphere after the impact, by energy, m.
        longhorn_j: acceleration noise energy (Longhorn 1952), J.
        holmes_j: acceleration noise energy (Holmes 1974), J.
        peak_pressure_pa: bound of the sound pressure at 1 m, Pa.
        transmitted_j: work on the plate, from the time series, J.
        transmitted_spectrum_j: work on the plate, from the spectrum of the force, J.
        plate_speed_max_m_s: largest plate speed at the contact point, m/s.
        radiated_j: metric of the study, sum of sigma E over the modes (eq. 3.12), J. It ranks
            impacts, but it can exceed the energy in the plate.
        radiated_maidanik_j: `radiated_j` with eq. 3.13, J.
        sound_j: energy that the plate radiates until rest (eq. 3.12), J.
        sound_maidanik_j: `sound_j` with eq. 3.13, J.
    """

    contact_time_s: float
    impact_speed_m_s: float
    next_impact_speed_m_s: float
    rebound_height_m: float
    longhorn_j: float
    holmes_j: float
    peak_pressure_pa: float
    transmitted_j: float
    transmitted_spectrum_j: float
    plate_speed_max_m_s: float
    radiated_j: float
    radiated_maidanik_j: float
    sound_j: float
    sound_maidanik_j: float


def longhorn_j(radius_m: float, impact_speed_m_s: float, rebound_speed_m_s: float) -> float:
    """Acceleration noise energy pi R^3/3 rho0 (v0^2 + v1^2) (Longhorn 1952), J."""
    squares = impact_speed_m_s**2 + rebound_speed_m_s**2
    return math.pi * radius_m**3 / 3.0 * AIR_DENSITY_KG_M3 * squares


def holmes_j(radius_m: float, impact_speed_m_s: float, contact_time_s: float) -> float:
    """Acceleration noise energy rho0 L^3 v0^2 (L/(c t0))^5 (Holmes 1974), J.

    L is the cube root of the sphere's volume; the study gives ratios only, where it cancels.
    """
    length = (4.0 / 3.0 * math.pi) ** (1.0 / 3.0) * radius_m
    ratio = length / (SOUND_SPEED_M_S * contact_time_s)
    return AIR_DENSITY_KG_M3 * length**3 * impact_speed_m_s**2 * ratio**5


def peak_pressure_pa(
    radius_m: float, impact_speed_m_s: float, contact_time_s: float, distance_m: float = 1.0
) -> float:
    """Upper bound of the acceleration noise's pressure at `distance_m`, Pa.

    rho0 c R v0/(2 r (4 d^4 + 1)) (1.32/(2 d^(2/3)) + 2 d^2), d = c t0/(pi R).
    """
    d = SOUND_SPEED_M_S * contact_time_s / (math.pi * radius_m)
    shape = (1.32 / (2.0 * d ** (2.0 / 3.0)) + 2.0 * d * d) / (4.0 * d**4 + 1.0)
    source = AIR_DENSITY_KG_M3 * SOUND_SPEED_M_S * radius_m * impact_speed_m_s
    return source / (2.0 * distance_m) * shape


def rebound_height_m(rebound_speed_m_s: float) -> float:
    """v1^2/(2 g), m; zero for a sphere that does not rise."""
    return max(rebound_speed_m_s, 0.0) ** 2 / (2.0 * GRAVITY_M_S2)


def closed_forms(
    sphere: Sphere, contact_time_s: float, impact_speed_m_s: float, rebound_speed_m_s: float
) -> dict[str, float]:
    """The fields of `ImpactNoise` that follow from contact time and speeds alone.

    Of speeds whose squares no number holds, as of a scheme that diverges, energies are inf.
    """
    plain = {
        "contact_time_s": contact_time_s,
        "impact_speed_m_s": impact_speed_m_s,
        "next_impact_speed_m_s": rebound_speed_m_s,
    }
    if not max(abs(impact_speed_m_s), abs(rebound_speed_m_s)) < _FASTEST_M_S:
        unknown = ("rebound_height_m", "longhorn_j", "holmes_j", "peak_pressure_pa")
        return plain | dict.fromkeys(unknown, math.inf)
    radius_m = sphere.radius_m
    return plain | {
        "rebound_height_m": rebound_height_m(rebound_speed_m_s),
        "longhorn_j": longhorn_j(radius_m, impact_speed_m_s, rebound_speed_m_s),
        "holmes_j": holmes_j(radius_m, impact_speed_m_s, contact_time_s),
        "peak_pressure_pa": peak_pressure_pa(radius_m, impact_speed_m_s, contact_time_s),
    }


_BLOCK, _BLOCKS = 64, 64  # steps of a block, and blocks that are summed together
_PAIRS_AT_ONCE = 1 << 23  # of two frequencies


@lru_cache(maxsize=16)
def _transform(modes: Oscillators, step_s: float) -> tuple[np.ndarray, ...]:
    """What transforms the steps of a force at the frequencies of oscillators.

    A force F_0 + F_1 (2 t/h - 1) over every step has, with a = w h/2, the sum of F_0 e^(-i w n h)
    times h e^(-i a) sin(a)/a, and that of F_1 times h e^(-i a) (-i) (sin a - a cos a)/a^2.

    Returns:
        e^(-i w n h) for the steps of a block, shape (_BLOCK, oscillators), the same for the starts
        of blocks, shape (_BLOCKS + 1, oscillators), and both factors, shape (oscillators,).
    """
    half = 0.5 * modes.omega * step_s
    held = step_s * np.sinc(half / np.pi) * np.exp(-1j * half)
    # (sin a - a cos a)/a^2 = a/3 (1 - a^2/10 + ...)
    small = np.abs(half) < 1e-2
    a = np.where(small, 1.0, half)
    odd = np.where(
        small, half / 3.0 * (1.0 - half * half / 10.0), (np.sin(a) - a * np.cos(a)) / (a * a)
    )
    tilted = -1j * odd * np.exp(-1j * half) * step_s
    of_step, of_block = (
        np.exp(-1j * step_s * steps[:, None] * modes.omega)
        for steps in (np.arange(_BLOCK), _BLOCK * np.arange(_BLOCKS + 1))
    )
    return of_step, of_block, held, tilted


@on_one_thread
def modal_drive(
    modes: Oscillators, step_s: float, contact_n: np.ndarray, actuator_n: np.ndarray
) -> np.ndarray:
    """Phi_c F_c(w_n) + Phi_a F_a(w_n) of every oscillator, N s, shape (oscillators,).

    Args:
        modes: The oscillators.
        step_s: Length of a step.
        contact_n: Mean and slope of the force up on the plate at the contact, N, (2, steps).
        actuator_n: The same of the actuator.
    """
    of_step, of_block, held, tilted = _transform(modes, step_s)
    steps = contact_n.shape[1]
    forces = np.zeros((4, -(-steps // _BLOCK), _BLOCK))
    forces.reshape(4, -1)[:, :steps] = *contact_n, *actuator_n
    sums = np.zeros((4, len(modes.omega)), complex)
    for end in range(forces.shape[1], 0, -_BLOCKS):
        first = max(end - _BLOCKS, 0)
        blocks = (forces[:, first:end] @ of_step.view(float)).view(complex)
        each = np.einsum("fbn,bn->fn", blocks, of_block[: end - first])
        sums = sums * of_block[end - first] + each
    contact, actuator = held * sums[::2] + tilted * sums[1::2]
    return np.asarray(modes.contact * contact + modes.actuator * actuator)


def shares_of_drive_j(modes: Oscillators, drive: np.ndarray) -> np.ndarray:
    """Energy that every oscillator takes, lambda/2 |drive|^2; J, shape (oscillators,).

    The integral of |F|^2 Re Y/pi over all frequencies for a spectrum that is smooth over a
    resonance; exact without damping. It needs no grid of frequencies, which for a loss
    factor of 1e-4 would have to be finer than 0.01 Hz.
    """
    return np.asarray(0.5 * modes.scale_per_kg * np.abs(drive) ** 2)


def audible(modes: Oscillators) -> int:
    """How many oscillators are up to 20 kHz: the first ones."""
    return int(np.searchsorted(modes.omega, 2.0 * np.pi * RADIATED_UP_TO_HZ, "right"))


def audible_alone(modes: Oscillators) -> Oscillators:
    """The oscillators up to 20 kHz alone; what a force gives each is the same as among others."""
    count = audible(modes)
    eta = modes.eta[:count] if isinstance(modes.eta, np.ndarray) else modes.eta
    return replace(
        modes,
        omega=modes.omega[:count],
        contact=modes.contact[:count],
        actuator=modes.actuator[:count],
        eta=eta,
    )


def mobility(modes: Oscillators, frequency_hz: np.ndarray) -> np.ndarray:
    """Point mobility i w lambda sum Phi^2/(w_n^2 (1 + i eta) - w^2) at the contact point.

    m/(N s), shape (frequencies,).
    """
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
    poles = modes.omega**2 * (1.0 + 1j * modes.eta)
    weights = modes.scale_per_kg * modes.contact**2
    sums = np.empty(len(omega), complex)
    group = max(1, _PAIRS_AT_ONCE // len(poles))
    for start in range(0, len(omega), group):
        some = slice(start, start + group)
        sums[some] = np.sum(weights / (poles - (omega[some] ** 2)[:, None]), axis=1)
    return 1j * omega * sums


def binned_energies_j(
    force_n: np.ndarray,
    step_s: float,
    real_mobility: np.ndarray,
    efficiencies: list[np.ndarray],
) -> list[float]:
    """Published sum of |F(w)|^2 Re Y(w)/pi sigma over the bins of a zero-padded FFT, times dw.

    `real_mobility` and each of `efficiencies` belong to the first bins, from 0 to 20 kHz. Bins of
    15 Hz miss most resonances of a lightly damped plate: such a sum is good for ratios of
    similar forces, not for joules.
    """
    length = fft_length(len(force_n))
    spectrum = np.fft.rfft(force_n, length)[: len(real_mobility)] * step_s
    density = np.abs(spectrum) ** 2 * real_mobility / np.pi
    width = 2.0 * np.pi / (length * step_s)
    return [float(np.sum(density * sigma) * width) for sigma in efficiencies]


def fft_length(samples: int) -> int:
    """Length of the transform of so many samples, zeros appended: a power of two, 2^16 at least."""
    return max(_FFT_LENGTH, 1 << (samples - 1).bit_length())


def audible_bins_hz(length: int, step_s: float) -> np.ndarray:
    """Frequencies of the bins up to 20 kHz of a transform of `length` (see `fft_length`)."""
    bins = np.fft.rfftfreq(length, step_s)
    return np.asarray(bins[bins <= RADIATED_UP_TO_HZ])


def impact_noise(
    spec: PlantSpec, modes: Oscillators, impact: Impact, drive: np.ndarray
) -> ImpactNoise:
    """Metrics of an impact of the consistent scheme, from its start until it is over; `drive`: of
    every oscillator by the forces at contact and actuator (see `modal_drive`), N s.

    Radiated energies are nan for any other structure than a simply supported plate, whose
    efficiencies are known. Without modes (`plant.NO_MODES`) all sums over modes are nan.
    """
    shares_j = shares_of_drive_j(modes, drive)
    return ImpactNoise(
        **closed_forms(
            spec.sphere, impact.duration_s, impact.impact_speed_m_s, impact.rebound_speed_m_s
        ),
        transmitted_j=impact.plate_energy_j,
        transmitted_spectrum_j=float(shares_j.sum()) if modes.modes else math.nan,
        plate_speed_max_m_s=impact.plate_speed_max_m_s,
        **_radiated_j(spec.plate.simply_supported, modes, shares_j),
    )


def _radiated_j(plate: Plate | None, modes: Oscillators, shares_j: np.ndarray) -> dict[str, float]:
    """The study's sums of sigma E, and what the modes radiate of their energies E, by fields."""
    if plate is None or not modes.modes:
        return dict.fromkeys(_RADIATED, math.nan)
    weights = _weights(plate, modes)
    sums = (shares_j[: weights.shape[1]] * weights).sum(axis=1)
    return dict(zip(_RADIATED, sums.tolist(), strict=True))


_RADIATED = [f"{kind}{name}_j" for kind in ("radiated", "sound") for name in _EFFICIENCIES]


@lru_cache(maxsize=16)
def _weights(plate: Plate, modes: Oscillators) -> np.ndarray:
    """What of the energies of the oscillators up to 20 kHz counts, for all impacts on a plate: a
    row for each of `_RADIATED`."""
    frequency = modes.omega / (2.0 * np.pi)
    count = audible(modes)
    weights = [by(plate, frequency)[:count] for by in _EFFICIENCIES.values()]
    for known in weights[:]:
        # pyrefly: ignore[bad-argument-type]
        air_eta = air_loss_factor(plate, frequency[:count], lambda *_, known=known: known)
        weights.append(radiated_parts(plate.eta, air_eta))
    return np.array(weights)


@lru_cache(maxsize=8)
def _audible(
    plate: Plate, point_m: tuple[float, float], omega_max: float, length: int, step_s: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Re Y and both radiation efficiencies on the bins of the published sum."""
    modes = oscillators(plate, point_m, point_m, omega_max)
    bins = audible_bins_hz(length, step_s)
    efficiencies = [by(plate, bins) for by in _EFFICIENCIES.values()]
    return mobility(modes, bins).real, efficiencies


class PublishedContact(NamedTuple):
    """The samples of a contact of the published scheme, from its start to the first one after it.

    Attributes:
        elastic_n: contact force without damping, N, shape (samples,).
        f_a: actuator force, N, shape (samples,).
        step_s: time between two samples, s.
        impact_speed_m_s: speed of the sphere before, m/s.
        relative_speed_m_s: speed of the sphere away from the plate at the last sample, m/s.
    """

    elastic_n: np.ndarray
    f_a: np.ndarray
    step_s: float
    impact_speed_m_s: float
    relative_speed_m_s: float


def published_noise(
    sphere: Sphere,
    plate: Plate,
    modes: Oscillators,
    point_m: tuple[float, float],
    green_v: np.ndarray,
    contact: PublishedContact,
) -> ImpactNoise:
    """Metrics of an impact as the published study formed them.

    F = -F_c + F_a without damping; v_p the sampled convolution with `green_v` from t = 0 on; the
    contact time counts one step more than there are samples, as published.
    """
    step_s = contact.step_s
    force = contact.f_a - contact.elastic_n
    speed = step_s * np.convolve(green_v[: len(force)], force)[: len(force)]
    rebound = contact.relative_speed_m_s + float(speed[-1])
    time_s = (len(force) + 1) * step_s
    held = np.zeros((2, 2, len(force)))
    held[:, 0] = -contact.elastic_n, contact.f_a
    shares = shares_of_drive_j(modes, modal_drive(modes, step_s, *held))
    length = fft_length(len(force))
    real, efficiencies = _audible(plate, point_m, float(np.pi / step_s), length, step_s)
    sounds = _radiated_j(plate, modes, shares)
    radiated, maidanik = binned_energies_j(force, step_s, real, efficiencies)
    return ImpactNoise(
        **closed_forms(sphere, time_s, contact.impact_speed_m_s, rebound),
        transmitted_j=float(np.sum(force * speed)) * step_s,
        transmitted_spectrum_j=float(np.sum(shares)),
        plate_speed_max_m_s=float(np.max(np.abs(speed))),
        radiated_j=radiated,
        radiated_maidanik_j=maidanik,
        **{name: sounds[name] for name in sounds if name.startswith("sound")},
    )
