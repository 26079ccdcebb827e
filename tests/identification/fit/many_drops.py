"""Fit records of the independent solver, with problems drawn at random.

Each problem has other materials, sizes, noise and length. Every start is 20 % off. The program
prints each fit, and counts intervals that hold the truth and verdicts on the model.

Run it with: python -m tests.identification.fit.many_drops --problems 40
"""

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import scipy

from hertzloop.identification.fit.fit import fit
from hertzloop.identification.fit.free_keys import parse_free_key
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.records.record import Record
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from tests.identification.fit.drops import Drop, scene_of

BALLS = {
    "steel": (210e9, 7800.0, 0.31), "glass": (64e9, 2500.0, 0.22),
    "tungsten carbide": (600e9, 15000.0, 0.22), "alumina": (370e9, 3900.0, 0.22),
}  # fmt: skip
PLATES = {
    "aluminium": (7.2e10, 2700.0, 0.34), "steel": (2.0e11, 7850.0, 0.29),
    "glass": (6.4e10, 2480.0, 0.23), "brass": (1.0e11, 8500.0, 0.33),
}  # fmt: skip
PRESSURE = 1e9
RADIUS, THICKNESS, HEIGHT = "sphere.radius_m", "plate.thickness_m", "sphere.drop_height_m"
LIMIT = "contact.limiting_pressure_pa"
# What is recorded, which keys are free, and the length in contact times and at least in seconds.
KINDS = [
    ("contact_force", (RADIUS, HEIGHT), 2.5, 0.0), ("contact_force", (LIMIT, RADIUS), 2.5, 0.0),
    ("v_p", (THICKNESS, RADIUS), 10.0, 3e-4), ("v_p", (THICKNESS,), 4.0, 1e-4),
]  # fmt: skip


def one(number: int, other: int = 0) -> tuple[str, FitResult, dict[str, float]]:
    """Fit problem `number`; `other` above zero draws other noise. Returns its description, the
    result and the true values."""
    g = np.random.default_rng(500 + number)
    ball, plate = list(BALLS)[g.integers(4)], list(PLATES)[g.integers(4)]
    thickness = float(np.exp(g.uniform(np.log(1e-3), np.log(20e-3))))
    radius = float(np.exp(g.uniform(np.log(1.5e-3), np.log(12e-3))))
    height, noise = float(g.uniform(0.01, 0.2)), float(g.choice([0.001, 0.003, 0.01]))
    loss_factor = float(np.exp(g.uniform(np.log(5e-4), np.log(5e-3))))
    quantity, keys, contacts, least_s = KINDS[number % 4]
    drop = Drop(
        radius, height, thickness, loss_factor, PRESSURE if LIMIT in keys else None,
        of_ball=BALLS[ball], of_plate=PLATES[plate],
    )  # fmt: skip
    setup = scene_of(drop)
    contact_s = rigid_contact_time_s(
        setup.sphere.mass_kg, setup.contact.stiffness, setup.sphere.impact_speed_m_s
    )
    duration_s = max(contacts * contact_s, least_s) * float(g.uniform(1.0, 1.6))
    time_s, force, speed = drop.simulate(duration_s)
    spline = scipy.interpolate.CubicSpline(time_s, force if quantity == "contact_force" else speed)
    step_s = max(0.5e-6, contact_s / 120.0)
    tau = np.arange(-400 * step_s + g.uniform() * step_s, duration_s, step_s)
    clean = np.where(tau > 0.0, spline(np.maximum(tau, 0.0)), 0.0)
    if quantity == "contact_force":
        clean = np.maximum(clean, 0.0)
    peak = np.max(np.abs(clean))
    value = 1.01 * clean + noise * peak * g.standard_normal(len(tau))
    true = {RADIUS: radius, HEIGHT: height, LIMIT: PRESSURE, THICKNESS: thickness}
    start = setup.vary({key: true[key] * 1.2 ** float(g.choice([-1, 1])) for key in keys})
    if other:
        again = np.random.default_rng(9000 + 100 * number + other)
        value = 1.01 * clean + noise * peak * again.standard_normal(len(tau))
    record = Record("drop", 0.0123 + tau * (1.0 + 3e-5), value, quantity)
    said = (
        f"{number}: {ball} of {1e3 * radius:.3g} mm on {1e3 * thickness:.3g} mm of {plate} from "
        f"{1e3 * height:.3g} mm, {quantity} of {1e6 * duration_s:.0f} us, noise {100 * noise:g} %"
    )
    result = fit(start, [record], [parse_free_key(start, key) for key in keys])
    return said, result, {key: true[key] for key in keys}


def print_estimates(result: FitResult, true: dict[str, float]) -> int:
    """Print each estimate against its true value. Returns how many intervals hold it."""
    held = 0
    for e in result.estimates:
        inside = (e.low or 0.0) <= true[e.key] <= (e.high or math.inf)
        held += inside
        away = math.log(e.value / true[e.key]) / (e.sd_log or math.nan)
        half = e.half_width_percent or math.nan
        words = "" if inside else ", MISSES"
        print(f"   {e.key}: {e.verdict}, {away:+.2f} sd, +-{half:.2g} %{words}")
    return held


def main() -> None:
    """Fit, print, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=40)
    parser.add_argument("--only", type=int, help="fit this problem with other seeds of noise")
    parser.add_argument("--seeds", type=int, default=24)
    given = parser.parse_args()
    held = asked = fits = 0
    with ProcessPoolExecutor(2) as pool:
        if given.only is None:
            found = pool.map(one, range(given.problems))
        else:
            found = pool.map(partial(one, given.only), range(1, given.seeds + 1))
        for said, result, true in found:
            fits += str(result.model) == "fits"
            print(f"{said}: {result.model}, residual {result.residual_over_noise:.3g}", flush=True)
            inside = print_estimates(result, true)
            held, asked = held + inside, asked + len(true)
    print(f"{held} of {asked} intervals hold the truth; the model fits in {fits}.")


if __name__ == "__main__":
    main()
