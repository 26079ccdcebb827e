"""Impacts cut out of a run's time series, with their noise metrics.

The metrics of an impact reach as far as `plant.metrics.impact_kernels` says: what follows the
impact does not count.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.loop.impact_end import impact_follower
from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import END
from hertzloop.plant.metrics.impacts import Impact, contacts, first_contact
from hertzloop.plant.metrics.noise import (
    ImpactNoise,
    PublishedContact,
    impact_noise,
    modal_drive,
    published_noise,
)
from hertzloop.plant.plant import modes_of
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, V_P, XI
from hertzloop.scene.setup import Setup

_BEHIND = 2  # steps after an impact, in which the rebound is seen


@dataclass(frozen=True)
class ImpactMetrics:
    """One impact; the metrics of the published scheme are the study's: contact time by samples,
    plate energy as summed.

    Attributes:
        start: first step in contact.
        end: first step after the contact.
        over: first step after the impact.
        contact_n: contact force until `end`, N; its elastic part in the published scheme.
        ended: whether the contact ended within the run.
        impact: metrics of the contact.
        noise: noise metrics.
    """

    start: int
    end: int
    over: int
    contact_n: np.ndarray
    ended: bool
    impact: Impact
    noise: ImpactNoise


def first_impact(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> ImpactMetrics | None:
    """Return the first of `impacts_of`; None without one."""
    return next(_impacts(setup, truth, modes), None)


def impacts_of(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> list[ImpactMetrics]:
    """Return the impacts of a run. A contact that the run's end cuts off has the metrics of its
    part.

    Args:
        setup: The setup of the run.
        truth: Its time series, shape (10, steps).
        modes: Modes among which the energy is divided; by default all of the plate.
    """
    return list(_impacts(setup, truth, modes))


def _impacts(setup: Setup, truth: np.ndarray, modes: Oscillators | None) -> Iterator[ImpactMetrics]:
    consistent = SCHEMES[setup.run.scheme].conserves
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    touching = truth[F_C] if consistent else (truth[XI] <= 0.0).astype(float)
    starts, ends = contacts(touching)
    speed_m_s = setup.plant.sphere.impact_speed_m_s
    steps = truth.shape[1]
    for start, end, following in zip(starts, [*ends, steps], [*starts[1:], steps], strict=False):
        if consistent:
            found = _impact(setup, truth, slice(start, end), following, modes)
            if found:
                yield found
            continue
        impact, noise, elastic_n, speed_m_s = published_impact(
            setup, truth[:, start : end + 1], start, speed_m_s
        )
        stop = start + len(elastic_n)
        yield ImpactMetrics(start, stop, stop, elastic_n, end < steps, impact, noise)


def _impact(
    setup: Setup, truth: np.ndarray, contact: slice, following: int, modes: Oscillators | None
) -> ImpactMetrics | None:
    """Return the impact of a contact, before that of the `following` one or the end; None if there
    is too little of it."""
    spec, start, modes = setup.plant, contact.start, modes or modes_of(setup.plant)
    lasts, before = impact_follower(setup), max(start - 1, 0)
    impact_kernels.follow_steps(lasts, *truth[[F_C, F_A, XI], start:following])
    over = start + int(lasts.counts[END])
    # The next impact counts with its first step.
    impact = first_contact(spec, truth[:, before : min(over + _BEHIND, following + 1)], before)
    if impact is None:
        return None
    own = truth[:, start:over]
    drive = modal_drive(modes, spec.step_s, -own[[F_C, F_C1]], own[[F_A, F_A1]])
    whole = replace(impact, plate_speed_max_m_s=float(np.abs(own[V_P]).max()))
    noise = impact_noise(spec, modes, whole, drive)
    contact_n = truth[F_C, contact].copy()
    ended = contact.stop < truth.shape[1]
    return ImpactMetrics(start, contact.stop, over, contact_n, ended, impact, noise)


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
