"""Appendix A.1: the force F_a,Y of a simplified impact model, and its table computed again.

The printed formula leaves open how the optimum is taken, how it comes back into time and what kappa
scales. Three readings are tried; each lasts as long as F_c0, as the constant force does.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from controller.laws.precomputed import mobility_force_n
from hertzloop.analysis.impacts import first_impact
from hertzloop.loop.compiled import simulate
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup
from plant.contact.hertz import tangent_stiffness_n_m
from plant.figures.sound import PointMobility, longhorn_any_j, longhorn_short_j
from plant.structures.radiation import critical_frequency_hz, maidanik_from_hz
from studies.published import tables

TABLE = Path(__file__).parent / "table_a1.csv"
FLAT = 0.55  # of max(F_c0): inferred from the published table, not printed in the study
READINGS = {
    "derived": "F_c of mass, spring and infinite plate, as derived; its own size",
    "derived, scaled": f"the same, scaled to {FLAT} max(F_c0), which is inferred",
    "flat": f"constant, {FLAT} max(F_c0), which is inferred",
}


@dataclass(frozen=True)
class Model:
    """F_c0 of a plant and what the simplified model makes of it, N, one value a step."""

    contact_n: np.ndarray
    mobility_n: np.ndarray


@lru_cache(maxsize=4)
def model(scheme: str) -> Model:
    """The aluminium plate without control. Raises ValueError without an impact."""
    row = tables.Row("aluminium", 0.05, ("controller.law=off",), True)
    setup = tables.scene_of(row, scheme)
    impact = first_impact(setup, simulate(setup).rows)
    if impact is None:
        raise ValueError(f"{setup.name}: no impact")
    about = setup.about_bodies
    return Model(impact.contact_n, mobility_force_n(about))


def force_n(reading: str, scheme: str) -> np.ndarray:
    """F_a,Y for kappa = 1, N, one value a step, as long as F_c0."""
    found = model(scheme)
    length, top = len(found.contact_n), FLAT * float(found.contact_n.max())
    if reading == "flat":
        return np.full(length, top)
    shape = np.zeros(length)
    part = found.mobility_n[:length]
    shape[: len(part)] = part
    return shape if reading == "derived" else shape * (top / shape.max())


def computed(reading: str, scheme: str) -> list[dict[str, Any]]:
    """The published rows with X_computed and X_difference after every figure X."""
    _, rows = tables.read_rows(TABLE)
    unit = force_n(reading, scheme)
    found = []
    for number, cells in enumerate(rows, 1):
        forces = [float(x) for x in float(cells["kappa"]) * unit]
        settings = ("controller.law=profile", f"controller.profile_n={forces}")
        row = tables.Row("aluminium", 0.05, settings, True)
        figures = tables.compute(row, scheme)
        found.append({**cells, **tables.with_differences(cells, figures, number)})
    return found


@dataclass(frozen=True)
class Line:
    """One number: which equation, of what, the number and its unit."""

    equation: str
    what: str
    value: float
    unit: str


def lines(setup: Setup) -> list[Line]:
    """Eq. 3.1, 3.3, 3.8b, and the limits of 3.13. Raises SceneError without an impact that ends."""
    setup = setup.without_control()
    spec = setup.plant
    impact = first_impact(setup, simulate(setup).rows)
    if impact is None or not impact.ended:
        raise SceneError("no impact ends within run.duration_s; take more")
    noise, sphere = impact.noise, spec.sphere
    time_s, v0, m = noise.contact_time_s, sphere.impact_speed_m_s, sphere.mass_kg
    any_j = longhorn_any_j(sphere.radius_m, v0, time_s)
    short_j = longhorn_short_j(sphere.radius_m, v0)
    found = [
        Line("3.1", "acceleration noise, any contact time", 1e6 * any_j, "uJ"),
        Line("3.3", "its limit for a short contact", 1e6 * short_j, "uJ"),
        Line("3.3", "limit over 3.1", short_j / any_j, ""),
        Line(
            "3.3", "c t0/R; the limit needs much less than 1", 340.0 * time_s / sphere.radius_m, ""
        ),
    ]
    # The spring is as stiff as the contact at its peak.
    spring = tangent_stiffness_n_m(spec.contact.stiffness, impact.impact.peak_force_n)
    mobility = PointMobility(m, spring, spec.local_plate.infinite_plate_impedance_n_s_m)
    cuts = (("w < 1/T", 1.0 / time_s), ("w < 2 pi/T", 2.0 * math.pi / time_s))
    found += [
        Line("3.8b (i)", "2 m/pi times the integral of Re Y_sys", mobility.share(), ""),
        *[Line("3.8b (ii)", f"the same for {what}", mobility.share(w), "") for what, w in cuts],
        *[
            Line("3.8b", f"energy for {what}, I = {name}", 1e6 * mobility.energy_j(i, w), "uJ")
            for name, i in (("m v0", m * v0), ("sqrt(2) m v0", math.sqrt(2.0) * m * v0))
            for what, w in cuts
        ],
        Line("", "plate energy of the run", 1e6 * noise.transmitted_j, "uJ"),
        Line("", "... of the kinetic energy", noise.transmitted_j / (0.5 * m * v0**2), ""),
    ]
    plate = spec.plate.separable
    if plate is not None:
        found += [
            Line("3.13", "not defined below", maidanik_from_hz(plate), "Hz"),
            Line("3.13", "critical frequency", critical_frequency_hz(plate), "Hz"),
        ]
    return found
