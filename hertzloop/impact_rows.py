"""Impacts cut out of a run's rows of truth, with their noise figures."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hertzloop import parts
from hertzloop.scene import Scene
from plant.collocation import flexibility_m_n
from plant.contact import GRAVITY_M_S2
from plant.impact_noise import impact_noise, published_noise
from plant.impacts import Impact, impacts
from plant.infinite import impedance_n_s_m
from plant.noise import ImpactNoise
from plant.plant import PlantSpec
from plant.plate import Oscillators, oscillators
from plant.thesis2008 import relative_speed_m_s, sampled

# Rows of truth, shape (8, steps).
XI, XI_S, XI_P, V_P, F_C, F_A, XI_A, F_C1 = range(8)


@dataclass(frozen=True)
class RowsOfImpact:
    """One impact: first step in contact, first step after it, contact force in between (N, its
    elastic part in the published scheme), whether it ended within the run, and its figures; those
    of the published scheme are the study's: contact time by samples, plate energy as summed."""

    start: int
    end: int
    contact_n: np.ndarray
    ended: bool
    impact: Impact
    noise: ImpactNoise


def first_impact(scene: Scene, rows: np.ndarray) -> RowsOfImpact | None:
    """First impact of a run; None without contact."""
    found = impacts_of_rows(scene, rows, most=1)
    return found[0] if found else None


def impacts_of_rows(scene: Scene, rows: np.ndarray, most: int | None = None) -> list[RowsOfImpact]:
    """Impacts of a run, at most `most`, from its rows of truth, shape (8, steps).

    A contact that the run's end cuts off has the figures of its part.
    """
    published = scene.run.scheme == "thesis2008"
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    touching = rows[XI] <= 0.0 if published else rows[F_C] != 0.0
    edges = np.diff(touching.astype(np.int8), prepend=np.int8(0), append=np.int8(0))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    spans = [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)][:most]
    if published:
        return _published(scene, rows, spans)
    return _consistent(scene, rows, spans, starts)


def consistent_impacts(
    scene: Scene, rows: np.ndarray, spec: PlantSpec | None = None
) -> list[Impact]:
    """Contact figures of every impact from the rows of truth alone; `spec` if the plant was
    another one than the scene's."""
    spec = spec or parts.plant_spec(scene)
    same = spec.contact_point_m == spec.actuator_point_m
    return impacts(
        rows[XI], rows[XI_S], modal_displacement(spec, rows), rows[F_C], rows[F_A],
        None if same else rows[XI_A],
        spec.sphere.mass_kg, spec.step_s, f_c1=rows[F_C1], v_p=rows[V_P],
        impedance_n_s_m=impedance_n_s_m(spec.plate) if spec.infinite_plate else None,
    )  # fmt: skip


def modal_displacement(spec: PlantSpec, rows: np.ndarray) -> np.ndarray:
    """Displacement at the struck point without that of the modes left out, a spring between the
    present contact force and the actuator force of the step before. It takes no energy."""
    spring = flexibility_m_n(spec)
    if spring == 0.0:
        return rows[XI_P]
    contact_n = spec.contact.stiffness * np.maximum(-rows[XI], 0.0) ** 1.5
    before = np.concatenate([[0.0], rows[F_A, :-1]])
    actuator_n = before if spec.contact_point_m == spec.actuator_point_m else 0.0
    return np.asarray(rows[XI_P] - spring * (actuator_n - contact_n))


def _published(scene: Scene, rows: np.ndarray, spans: list[tuple[int, int]]) -> list[RowsOfImpact]:
    """The study's figures: over the samples of the contact and the first one after."""
    spec, h, steps = parts.plant_spec(scene), scene.step_s, rows.shape[1]
    modes, (_, green_v, _) = sampled(spec.plate, spec.contact_point_m, h, steps + 2)
    v0 = spec.sphere.impact_speed_m_s
    found = []
    for start, end in spans:
        last = min(end, steps - 1)
        xi, f_a = rows[XI, start : last + 1], rows[F_A, start : last + 1]
        elastic = spec.contact.stiffness * np.maximum(-xi, 0.0) ** 1.5
        noise = published_noise(
            spec.sphere, spec.plate, modes, spec.contact_point_m, green_v, elastic, f_a, h,
            impact_speed_m_s=v0, relative_speed_m_s=relative_speed_m_s(xi, v0, h),
        )  # fmt: skip
        impact = Impact(
            start_s=start * h,
            duration_s=noise.contact_time_s,
            impact_speed_m_s=v0,
            rebound_speed_m_s=noise.next_impact_speed_m_s,
            peak_force_n=float(rows[F_C, start:end].max()),
            plate_energy_j=noise.transmitted_j,
        )
        found.append(RowsOfImpact(start, end, elastic[: end - start], end < steps, impact, noise))
        fall = 2.0 * GRAVITY_M_S2 * max(float(xi[-1]), 0.0)
        v0 = math.sqrt(noise.next_impact_speed_m_s**2 + fall)
    return found


@lru_cache(maxsize=8)
def modes_of(spec: PlantSpec) -> Oscillators:
    return oscillators(
        spec.plate, spec.contact_point_m, spec.actuator_point_m,
        2.0 * math.pi * spec.frequency_limit_hz,
    )  # fmt: skip


def _consistent(
    scene: Scene, rows: np.ndarray, spans: list[tuple[int, int]], starts: np.ndarray
) -> list[RowsOfImpact]:
    """Figures from the start of a contact to that of the next."""
    spec, steps = parts.plant_spec(scene), rows.shape[1]
    until = [*(int(s) for s in starts[1:]), steps]
    found = []
    for (start, end), stop, impact in zip(
        spans, until, consistent_impacts(scene, rows), strict=False
    ):
        noise = impact_noise(
            spec.sphere, spec.plate, modes_of(spec),
            -rows[F_C, start:stop], rows[F_A, start:stop], -rows[F_C1, start:stop],
            work_j=impact.plate_energy_j,
            plate_speed_m_s=rows[V_P, start:stop],
            step_s=scene.step_s,
            contact_time_s=impact.duration_s,
            impact_speed_m_s=impact.impact_speed_m_s,
            rebound_speed_m_s=impact.rebound_speed_m_s,
        )  # fmt: skip
        found.append(RowsOfImpact(start, end, rows[F_C, start:end], end < steps, impact, noise))
    return found
