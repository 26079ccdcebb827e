"""Fit files of the independent solver, with problems and measurements drawn at random.

Each problem has other bodies, another quantity, noise, converter, clock, gain, filters and zero of
time. Each record is written as CSV, read again and fitted from a start up to 20 % off. The program
prints each fit, and counts intervals that hold the truth and verdicts on the model.

Run it with: python -m tests.fitting.fit.many_records --problems 60
"""

import argparse
import math
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.records.reading import read_record
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.scene.setup import Setup
from tests.fitting.fit.drops import BALLS, GRAVITY, PLATES, Drop, scene_of
from tests.fitting.fitting import HEIGHT, PRESSURE, RADIUS, THICKNESS

COLUMNS = {
    "contact_force": "contact_force_n",
    "v_p": "v_p_m_s",
    "acceleration": "acceleration_m_s2",
    "xi_p": "xi_p_m",
    "xi": "xi_m",
    "xi_s": "xi_s_m",
}
KEYS = {
    "contact_force": [(RADIUS, HEIGHT), (PRESSURE, HEIGHT), (PRESSURE, RADIUS)],
    "v_p": [(THICKNESS, RADIUS), (THICKNESS,), (THICKNESS, PRESSURE), (RADIUS, HEIGHT)],
    "acceleration": [(THICKNESS, RADIUS), (THICKNESS,)],
    "xi_p": [(THICKNESS, RADIUS), (THICKNESS,)],
    "xi": [(THICKNESS,), (RADIUS,)],
    "xi_s": [(THICKNESS,), (RADIUS,)],
}
LEAD_S = 5e-6


def _low_pass(value: np.ndarray, step_s: float, corner_hz: float) -> np.ndarray:
    """A first-order filter, by the bilinear rule at 50 ns."""
    b, a = scipy.signal.butter(1, corner_hz, fs=1.0 / step_s)
    return np.asarray(scipy.signal.lfilter(b, a, value))


def _signals(drop: Drop, duration_s: float, mass_kg: float) -> tuple[np.ndarray, dict[str, Any]]:
    """Times after the touch and every quantity but the acceleration; zero or flight before it."""
    time_s, force, speed = drop.simulate(duration_s)
    step_s = time_s[1]
    plate = scipy.integrate.cumulative_simpson(speed, dx=step_s, initial=0.0)
    fall = scipy.integrate.cumulative_simpson(force / mass_kg - GRAVITY, dx=step_s, initial=0.0)
    fall -= math.sqrt(2 * GRAVITY * drop.height)
    ball = scipy.integrate.cumulative_simpson(fall, dx=step_s, initial=0.0)
    return time_s, {
        "contact_force": force,
        "v_p": speed,
        "xi_p": plate,
        "xi_s": ball,
        "xi": ball - plate,
    }


def written(number: int, folder: Path) -> tuple[str, Path, Setup, dict[str, float]]:
    """Write the record of problem `number`. Returns its description, its file, the setup to start
    from, and the true values of the free keys."""
    g = np.random.default_rng(70_000 + number)
    ball, plate = list(BALLS)[g.integers(4)], list(PLATES)[g.integers(4)]
    thickness = float(np.exp(g.uniform(np.log(1e-3), np.log(20e-3))))
    radius = float(np.exp(g.uniform(np.log(1e-3), np.log(12e-3))))
    height = float(g.uniform(0.01, 0.3))
    noise = float(np.exp(g.uniform(np.log(5e-4), np.log(1e-2))))
    size = float(g.uniform(0.2, 0.6))
    loss_factor = float(np.exp(g.uniform(np.log(3e-4), np.log(5e-3))))
    quantity = list(COLUMNS)[g.choice(6, p=[0.3, 0.3, 0.15, 0.1, 0.1, 0.05])]
    choices = KEYS[quantity]
    keys = choices[g.integers(len(choices))]
    pressure = float(g.uniform(5e8, 2e9)) if PRESSURE in keys else None
    drop = Drop(
        radius,
        height,
        thickness,
        loss_factor,
        pressure,
        size,
        of_ball=BALLS[ball],
        of_plate=PLATES[plate],
    )
    setup = scene_of(drop)
    contact_s = rigid_contact_time_s(
        setup.sphere.mass_kg, setup.contact.stiffness, setup.sphere.impact_speed_m_s
    )
    long = {"contact_force": 2.5, "xi": 3.0, "xi_s": 3.0}.get(quantity, 12.0)
    duration_s = min(long * contact_s * float(g.uniform(1.0, 2.0)), 1.5e-3)
    time_s, signals = _signals(drop, duration_s + 3 * LEAD_S, setup.sphere.mass_kg)
    step_s = float(time_s[1])
    table, shown = [], signals["v_p" if quantity == "acceleration" else quantity]
    if quantity == "acceleration":
        corner_hz = float(g.uniform(30e3, 120e3))
        # The low-passed derivative of a signal is what its low-pass misses, times the corner.
        shown = 2 * math.pi * corner_hz * (shown - _low_pass(shown, step_s, corner_hz))
        table.append(f"low_pass_hz = {corner_hz!r}")
    elif quantity in ("contact_force", "v_p") and g.uniform() < 0.3:
        corner_hz = float(g.uniform(80e3, 400e3))
        shown = _low_pass(shown, step_s, corner_hz)
        table.append(f"low_pass_hz = {corner_hz!r}")
    if quantity in ("contact_force", "v_p", "acceleration") and g.uniform() < 0.3:
        corner_hz = float(g.uniform(0.5, 50.0))
        shown = shown - _low_pass(shown, step_s, corner_hz)
        table.append(f"ac_coupling_hz = {corner_hz!r}")
    spline = scipy.interpolate.CubicSpline(time_s, shown)
    interval_s = contact_s / float(np.exp(g.uniform(np.log(30), np.log(300))))
    quiet = int(g.integers(220, 600))
    tau = np.arange(-quiet * interval_s + g.uniform() * interval_s, duration_s, interval_s)
    clean = np.where(tau > 0.0, spline(np.maximum(tau, 0.0)), 0.0)
    if quantity in ("xi", "xi_s"):
        speed = math.sqrt(2 * GRAVITY * height)
        clean = np.where(tau < 0.0, -tau * speed - 0.5 * GRAVITY * tau**2, clean)
    elif quantity == "contact_force" and not table:
        clean = np.maximum(clean, 0.0)
    peak = (
        float(np.max(np.abs(clean[tau > 0.0])))
        if quantity in ("xi", "xi_s")
        else float(np.max(np.abs(clean)))
    )
    gain = 1.0 + 0.01 * float(g.standard_normal())
    ppm, zero_s = 30.0 * float(g.standard_normal()), float(g.uniform(-0.02, 0.1))
    offset = 0.0 if quantity in ("xi", "xi_s") else 0.02 * peak * float(g.standard_normal())
    value = gain * clean + offset + noise * peak * g.standard_normal(len(tau))
    bits = int(g.integers(8, 17)) if g.uniform() < 0.6 else 0
    if bits:
        level = 2.0 * float(g.uniform(1.1, 3.0)) * float(np.max(np.abs(value))) / 2**bits
        value = np.round(value / level) * level
    path = folder / f"drop-{number}.csv"
    about = "\n".join(("[record]", *table, "sensitivity_uncertainty = 0.01"))
    path.with_suffix(".toml").write_text(about)
    lines = [f"time_s,{COLUMNS[quantity]}"]
    rows = zip(zero_s + tau * (1.0 + 1e-6 * ppm), value, strict=True)
    path.write_text("\n".join([*lines, *(f"{t:.11g},{v:.9g}" for t, v in rows)]) + "\n")
    true = {RADIUS: radius, HEIGHT: height, PRESSURE: pressure or 0.0, THICKNESS: thickness}
    start = setup.vary(
        {key: true[key] * float(g.uniform(1.0, 1.2)) ** float(g.choice([-1, 1])) for key in keys}
    )
    said = f"{number}: {ball} on {plate}, {quantity}, {', '.join(table) or 'no filter'}"
    return said, path, start, {key: true[key] for key in keys}


def one(number: int) -> tuple[str, FitResult | str, dict[str, float]]:
    """Write, read and fit problem `number`. Returns its description, the result or why there is
    none, and the true values."""
    with tempfile.TemporaryDirectory() as folder:
        said, path, start, true = written(number, Path(folder))
        try:
            record = read_record(path)
            return said, fit(start, [record], [parse_free_key(start, key) for key in true]), true
        except ValueError as error:
            return said, str(error), true


def main() -> None:
    """Fit, print, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    held = asked = refused = 0
    verdicts: dict[str, int] = {}
    with ProcessPoolExecutor(2) as pool:
        for said, result, true in pool.map(one, range(given.first, given.first + given.problems)):
            if isinstance(result, str):
                refused += 1
                print(f"{said}: REFUSED: {result}", flush=True)
                continue
            verdicts[str(result.model)] = verdicts.get(str(result.model), 0) + 1
            print(f"{said}: {result.model}, {' '.join(result.reasons)}", flush=True)
            for e in result.estimates:
                inside = (e.low or 0.0) <= true[e.key] <= (e.high or math.inf)
                held, asked = held + inside, asked + 1
                print(f"   {e.key}: {e.verdict}{'' if inside else ', MISSES'}", flush=True)
    print(f"{held} of {asked} intervals hold the truth; verdicts {verdicts}; {refused} refused.")


if __name__ == "__main__":
    main()
