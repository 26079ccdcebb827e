"""The coefficient of restitution on an infinite plate, against Zener's equation."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from benchmarks.zener import solved
from hertzloop.cli.options import JsonOption
from hertzloop.closed_loop.parts import series_under
from hertzloop.plant import time_series as ts
from hertzloop.scene.build import build_plant

_LAMBDAS = (0.05, 0.1, 0.25, 0.5, 1.0, 1.5)


def restitution_on_infinite_plate(inelasticity: float) -> float:
    """Return what the simulation gives on an infinite plate of this inelasticity lambda."""
    setup = load(
        "aluminium-3mm",
        ["controller.law=off", "run.plate_model=infinite", "run.step_ns=250", "run.lead_in_s=2e-6"],
    )

    def lam(h: float) -> float:
        s = setup.vary({"plate.thickness_m": h})
        mass, v = s.mechanics.sphere.mass_kg, s.mechanics.sphere.impact_speed_m_s
        t = (mass / (s.mechanics.contact.stiffness * math.sqrt(v))) ** 0.4
        return mass / (s.mechanics.local_plate.infinite_plate_impedance_n_s_m * t)

    h = float(scipy.optimize.brentq(lambda h: lam(h) - inelasticity, 1e-4, 0.05, xtol=1e-14))
    one = setup.vary({"plate.thickness_m": h, "run.duration_s": 4e-4})
    rows = series_under(build_plant(one), np.zeros(one.run.steps))
    ended = int(np.flatnonzero(rows[ts.F_C] > 0.0)[-1]) + 2
    speed = (rows[ts.XI_S, ended + 1] - rows[ts.XI_S, ended]) / one.run.step_s
    return float(speed) / one.mechanics.sphere.impact_speed_m_s


@dataclass(frozen=True)
class Compared:
    """The coefficient of restitution at an inelasticity lambda, by theory and simulated."""

    inelasticity: float
    theory: float
    simulated: float


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Compare the coefficient of restitution on an infinite plate with Zener's equation.

    The equation is integrated by itself, without any part of the simulation. With --quick there are
    two values of lambda.

    Example: python -m benchmarks.fit_validation --quick
    """
    with results_in(folder, "fit_validation", "modal", json_file=json_file) as results:
        found = [
            Compared(x, solved(x)[2], restitution_on_infinite_plate(x))
            for x in tracked("Zener", _LAMBDAS[2:4] if quick else _LAMBDAS)
        ]
        results.write("fit_validation", found)
        results.table(
            "coefficient of restitution on an infinite plate",
            {
                "lambda": "{.inelasticity:g}",
                "theory": "{.theory:.5f}",
                "simulated": "{.simulated:.5g}",
            },
            found,
            text=0,
        )
        worst = max(abs(c.simulated - c.theory) for c in found)
        results.conclude(
            f"The coefficient of restitution is within {worst:.1e} of Zener's equation."
        )


if __name__ == "__main__":
    start("benchmarks.fit_validation")
