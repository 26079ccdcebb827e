"""Growth rates that the linear margin predicts, against the compiled step with the loop closed.

The sphere stays in flight. `python -m benchmarks.margin` runs all cases, `--quick` the first two.
"""

import math
import sys

import numpy as np

from hertzloop.loop.compiled import simulate
from hertzloop.plant import state_kernels as pk
from hertzloop.plant import time_series as ts
from hertzloop.setup import load
from hertzloop.setup.setup import Setup
from hertzloop.studies.margin.margin import margin_of

_E_FOLDS = 60.0
_LAW = ("controller.law=velocity_feedback", "sensors.quantity=v_p", "run.lead_in_s=0.09")
# Scene and settings.
CASES = (
    ("aluminium-20mm", ("controller.kappa=0.4",)),
    ("aluminium-3mm", ("controller.kappa=0.4",)),
    ("aluminium-20mm", ("controller.kappa=0.4", "controller.latency_us=5")),
    ("aluminium-20mm", ("controller.kappa=0.6", "controller.latency_us=3")),
    ("offcentre-6mm", ("controller.kappa=0.3",)),
    ("aluminium-20mm", ("controller.kappa=0.4", "actuator.bandwidth_hz=20000")),
)  # fmt: skip


def simulated_growth_per_s(setup: Setup, expected_per_s: float) -> float:
    """Return the growth of the plate's velocity in the compiled closed loop in flight, 1/s.

    Fifty small random forces excite the plate before the loop is closed. The run lasts for 60
    e-folds of the expected growth, so that the fastest pole dominates, or to the end of the flight.
    """
    steps = int((setup.lead_in_s - 1e-4) / setup.step_s)
    if expected_per_s:
        steps = min(steps, int(_E_FOLDS / (abs(expected_per_s) * setup.step_s)))
    setup = setup.vary({"sensors.bits": "ideal", "controller.bits": "ideal"})
    setup = setup.on_plate("modal").lasting(max(steps, 200))
    plant = setup.start_plant()
    size_n = math.exp(-expected_per_s * steps * setup.step_s)
    ts.series_under(plant, size_n * np.random.default_rng(5).standard_normal(50))
    plant.state.counts[pk.STEP] = 0
    rows = simulate(setup, own_plant=plant).rows
    if rows[ts.F_C].any():
        raise ValueError("the sphere touched the plate within the flight")
    speed, width = rows[ts.V_P], rows.shape[1] // 5
    late = np.sqrt(np.mean(speed[-width:] ** 2))
    before = np.sqrt(np.mean(speed[-3 * width : -2 * width] ** 2))
    return math.log(late / before) / (2 * width * setup.step_s)


def main(quick: bool = False) -> None:
    """Print predicted and simulated growth."""
    print("scene                                predicted 1/s  simulated 1/s  difference")
    for scene, settings in CASES[: 2 if quick else None]:
        setup = load(scene, [*_LAW, *settings])
        found = margin_of(setup)
        name = f"{scene} {' '.join(s.partition('.')[2] for s in settings)}"
        if not found.growth_per_s:
            print(f"{name:40} stable, or undecided")
            continue
        real = simulated_growth_per_s(setup, found.growth_per_s)
        away = real / found.growth_per_s - 1.0
        print(f"{name:60} {found.growth_per_s:10.4g} {real:10.4g} {away:+.1e}", flush=True)


if __name__ == "__main__":
    main("--quick" in sys.argv)
