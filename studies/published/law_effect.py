"""What the published law does to rebound and plate energy: published against consistent scheme."""

import math
from dataclasses import dataclass

from hertzloop.analysis.impacts import consistent_impacts, first_impact
from hertzloop.loop.compiled import simulate
from hertzloop.setup import Setup, load
from plant.figures.calibration import calibrate_viscous

_LAW = "controller.law=slope_threshold"
_OFF = "controller.law=off"
_LASTS = "run.duration_s=0.06"  # all contacts of the first arrival


@dataclass(frozen=True)
class LawEffect:
    """kappa = 0.8, v_thr = -0.25 m/s without latency, against no control.

    Speeds: of the sphere when it leaves for good (consistent: after the last contact within
    60 ms); energies: work on the plate in all these contacts.
    """

    sphere: str
    scheme: str
    leaves_m_s: float
    without_m_s: float
    height_percent: float
    plate_mj: float
    without_mj: float
    plate_db: float


def law_effects() -> list[LawEffect]:
    """Both spheres, both schemes."""
    found = []
    for radius_mm in (3, 20):
        radius = f"sphere.radius_m={radius_mm / 1000}"
        spec = load("thesis-aluminium", [radius]).plant
        damping = calibrate_viscous(spec, spec.plate.material.restitution)
        published = [radius, f"contact.viscous_n_s_m={damping!r}"]
        for source, settings, measure in (
            ("thesis-aluminium", published, _published),
            (f"aluminium-{radius_mm}mm", [_LASTS], _consistent),
        ):
            speed, energy = measure(load(source, [*settings, _LAW]))
            speed_0, energy_0 = measure(load(source, [*settings, _OFF]))
            found.append(
                LawEffect(
                    sphere=f"R = {radius_mm} mm",
                    scheme=load(source).scheme,
                    leaves_m_s=speed,
                    without_m_s=speed_0,
                    height_percent=100.0 * (speed / speed_0) ** 2,
                    plate_mj=1e3 * energy,
                    without_mj=1e3 * energy_0,
                    plate_db=10.0 * math.log10(energy / energy_0),
                )
            )
    return found


def _published(setup: Setup) -> tuple[float, float]:
    impact = first_impact(setup, simulate(setup).rows)
    if impact is None or not impact.ended:
        raise ValueError(f"{setup.name}: the first contact does not end within the run")
    return impact.noise.next_impact_speed_m_s, impact.noise.transmitted_j


def _consistent(setup: Setup) -> tuple[float, float]:
    found = consistent_impacts(setup, simulate(setup).rows)
    return found[-1].rebound_speed_m_s, sum(impact.plate_energy_j for impact in found)
