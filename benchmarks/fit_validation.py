"""The model against theory and against published measurements, as a table.

Zener's equation is integrated here by itself, without any part of the simulation.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import scipy

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    write_records,
    written,
)
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.scene.build import build_plant
from hertzloop.scene.setup import Setup, load

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
    speed = float(np.diff(run.truth[ts.XI_S])[-1]) / run.step_s
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
        return mass / (s.mechanics.local_plate.infinite_plate_impedance_n_s_m * t)

    h = float(scipy.optimize.brentq(lambda h: lam(h) - inelasticity, 1e-4, 0.05, xtol=1e-14))
    one = setup.vary({"plate.thickness_m": h, "run.duration_s": 4e-4})
    rows = ts.series_under(build_plant(one), np.zeros(one.steps))
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


_DROPS_M = (0.01, 0.03, 0.1)


def mclaskey_us(height_m: float) -> float:
    """Return the contact time of a 1.58 mm steel ball on 50 mm of steel, us."""
    setup = load("aluminium-3mm", [
        *_MASSIVE, "sphere.radius_m=0.00079", f"sphere.drop_height_m={height_m}",
    ])  # fmt: skip
    return 1e6 * _impact(setup)[1]


@dataclass(frozen=True)
class Compared:
    """A number of the simulation beside that of theory; nan where a source has no number."""

    what: str
    unit: str
    theory: float
    simulated: float


def zener_compared(quick: bool) -> list[Compared]:
    """Return the coefficient of restitution on an infinite plate, by inelasticity."""
    return [
        Compared(f"restitution, lambda {x:g}", "", zener(x), restitution_on_infinite_plate(x))
        for x in tracked("Zener", _LAMBDAS[2:4] if quick else _LAMBDAS)
    ]


def published_compared() -> list[Compared]:
    """Return what published measurements speak of."""
    found = [
        Compared(f"contact time, 1.58 mm steel ball from {1e3 * drop:g} mm (McLaskey)", "us",
                 math.nan, mclaskey_us(drop))
        for drop in tracked("McLaskey", _DROPS_M)
    ]  # fmt: skip
    return found + [
        Compared(f"contact longer than Hertz's, {kind} (Gugan)", "%", math.nan, gugan(kind))
        for kind in tracked("Gugan", ("hunt_crossley", "thornton"))
    ]


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Compare the model with theory and with published measurements.

    Zener's equation is integrated by itself, without any part of the simulation. Published numbers
    are those of abstracts and first pages. With --quick there are two numbers of theory.

    Example: python -m benchmarks.fit_validation --quick
    """
    check_json(json_file)
    with results_in(folder, "fit_validation") as made:
        compile_first()
        found = zener_compared(quick)
        away = [(c.what, abs(c.simulated - c.theory)) for c in found]
        found += [] if quick else published_compared()
        write_records(made / "fit_validation.csv", found)
        bars(made / "fit_validation.png", "Zener's equation and simulation",
             "difference of the coefficient of restitution", away, log=True)  # fmt: skip
    rows = [(c.what, "" if math.isnan(c.theory) else f"{c.theory:.5f}", f"{c.simulated:.5g}",
             c.unit) for c in found]  # fmt: skip
    out.print(number_table("model against theory", ("what", "theory", "simulated", "unit"), rows,
                           text=1))  # fmt: skip
    written(made, "fit_validation.csv", "fit_validation.png")
    worst = max(x for _, x in away)
    conclude(f"The coefficient of restitution is within {worst:.1e} of Zener's equation.")
    write_json(json_file, {"compared": [asdict(c) for c in found]})


if __name__ == "__main__":
    start("benchmarks.fit_validation")
