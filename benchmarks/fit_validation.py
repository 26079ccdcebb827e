"""The model against theory and against published measurements, as a table.

`python -m benchmarks.fit_validation --out FILE.json`. Zener's equation is integrated here by
itself, without any part of the simulation. Published numbers are those of abstracts and first
pages.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.setup import Setup, load
from hertzloop.studies.fit.model import FrozenModel

_LAMBDAS = (0.05, 0.1, 0.25, 0.5, 1.0, 1.5)
_MASSIVE = (
    "controller.law=off", "plate.thickness_m=0.05", "plate.material=steel", "run.accuracy=1e-4",
)  # fmt: skip
_LOSS = 0.4  # of the energy, Gugan 2000


def zener(inelasticity: float) -> float:
    """Return the coefficient of restitution on an infinite plate (Zener 1941, Phys. Rev. 59, 669).

    s'' + s^1.5 + lambda (s^1.5)' = 0, s(0) = 0, s'(0) = 1, until s is zero again; the sphere leaves
    with the integral of s^1.5 less one.
    """

    def right(_: float, y: np.ndarray) -> list[float]:
        deep, rate, _impulse = y
        root = math.sqrt(max(deep, 0.0))
        return [rate, -root * deep - inelasticity * 1.5 * root * rate, root * max(deep, 0.0)]

    def out(_: float, y: np.ndarray) -> float:
        return float(y[0]) if y[1] < 0.0 else 1.0

    out.terminal = True  # type: ignore[attr-defined]
    solved = scipy.integrate.solve_ivp(
        right, (0.0, 500.0), [0.0, 1.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14, events=out,
        max_step=0.05,
    )  # fmt: skip
    return float(solved.y[2, -1]) - 1.0


def _impact(setup: Setup) -> tuple[float, float, float]:
    """Restitution, contact time (s) and loss of the sphere's energy of the first impact."""
    lasts = rigid_contact_time_s(
        setup.sphere.mass_kg, setup.contact.stiffness, setup.sphere.impact_speed_m_s
    )
    model = FrozenModel(setup, 2.5 * lasts, 1e-4)
    run = model.run({}, 2.5 * lasts)
    fine = np.linspace(0.0, 2.4 * lasts, 20_001)
    touching = fine[run.force_n(fine) > 0.0]
    speed = float(np.diff(run.rows[ts.XI_S])[-1]) / run.step_s
    time_s = float(touching[-1])
    speed += 9.81 * (float(run.time_s[-1]) - time_s)  # gravity since the end of contact
    e = speed / run.speed_m_s
    return e, time_s, 1.0 - e * e


def restitution_on_infinite_plate(inelasticity: float) -> float:
    """Return what the simulation gives on an infinite plate of this inelasticity lambda."""
    setup = load("aluminium-3mm", ["controller.law=off", "run.plate_model=infinite",
                                   "run.step_ns=250", "run.lead_in_s=2e-6"])  # fmt: skip

    def lam(h: float) -> float:
        s = setup.vary({"plate.thickness_m": h})
        mass, v = s.sphere.mass_kg, s.sphere.impact_speed_m_s
        t = (mass / (s.contact.stiffness * math.sqrt(v))) ** 0.4
        return mass / (s.bodies.local_plate.infinite_plate_impedance_n_s_m * t)

    h = float(scipy.optimize.brentq(lambda h: lam(h) - inelasticity, 1e-4, 0.05, xtol=1e-14))
    one = setup.vary({"plate.thickness_m": h, "run.duration_s": 4e-4})
    rows = ts.series_under(one.start_plant(), np.zeros(one.steps))
    ended = int(np.flatnonzero(rows[ts.F_C] > 0.0)[-1]) + 2
    speed = (rows[ts.XI_S, ended + 1] - rows[ts.XI_S, ended]) / one.step_s
    return float(speed) / one.sphere.impact_speed_m_s


def gugan(kind: str) -> float:
    """Return how much longer than Hertz's a contact lasts that loses 40 % of its energy, %."""
    base = load("aluminium-3mm", _MASSIVE)
    elastic = _impact(base)[1]

    def of(x: float) -> tuple[float, float, float]:
        if kind == "hunt_crossley":
            return _impact(base.vary({"contact.damping": kind, "contact.restitution": x}))
        return _impact(
            base.vary({"contact.plasticity": kind, "contact.limiting_pressure_pa": 1e9 * x})
        )

    low, high = (0.5, 0.99) if kind == "hunt_crossley" else (0.3, 3.0)
    x = float(scipy.optimize.brentq(lambda x: of(x)[2] - _LOSS, low, high, xtol=1e-4))
    return 100.0 * (of(x)[1] / elastic - 1.0)


def mclaskey() -> dict[str, list[float]]:
    """Return contact times of a 1.58 mm steel ball on 50 mm of steel, us, from 10, 30, 100 mm."""
    found = []
    for height in (0.01, 0.03, 0.1):
        setup = load("aluminium-3mm", [
            *_MASSIVE, "sphere.radius_m=0.00079", f"sphere.drop_height_m={height}",
        ])  # fmt: skip
        found.append(1e6 * _impact(setup)[1])
    return {"drop_mm": [10.0, 30.0, 100.0], "contact_us": found}


def results() -> dict[str, Any]:
    """Return all numbers of the page."""
    return {
        "zener": [
            {"lambda": x, "theory": zener(x), "simulated": restitution_on_infinite_plate(x)}
            for x in _LAMBDAS
        ],
        "mclaskey_and_glaser_2010": mclaskey(),
        "gugan_2000_longer_percent": {k: gugan(k) for k in ("hunt_crossley", "thornton")},
    }


def main() -> None:
    """Print the numbers as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="file for the numbers, JSON")
    given = parser.parse_args()
    text = json.dumps(results(), indent=1)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
