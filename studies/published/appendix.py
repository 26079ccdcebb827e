"""Appendix A.1: the force F_a,Y of a simplified impact model, and its table computed again.

The printed formula leaves open how the optimum is taken, how it comes back into time and what kappa
scales. Three readings are tried; each lasts as long as F_c0, as the constant force does.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from controller.laws.precomputed import mobility_force_n
from hertzloop.analysis.impacts import first_impact
from hertzloop.loop.compiled import simulate
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
