"""Growth rates that the linear margin predicts, against the compiled step with the loop closed.

The sphere stays in flight. `python -m benchmarks.margin` runs all cases, `--quick` the first two.
"""

import math
import sys

import numpy as np

from hertzloop.plant import state_kernels as pk
from hertzloop.plant.schemes import collocation_kernels as k
from hertzloop.setup import load
from hertzloop.setup.setup import Setup
from hertzloop.studies.margin.identify import law_filter
from hertzloop.studies.margin.margin import margin_of

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


def simulated_growth_per_s(setup: Setup, steps: int) -> float:
    """Return the growth of the plate's velocity between the middle and the end of `steps` steps
    under velocity feedback without converters, 1/s."""
    gain = law_filter(setup).direct
    plant = setup.on_plate("modal").start_plant()
    latency = setup.line.latency_steps
    commands = np.zeros(steps + latency + 2)
    commands[:50] = np.random.default_rng(5).standard_normal(50)
    speed = np.zeros(steps)
    for i in range(steps):
        speed[i] = plant.state.body[pk.V_P]
        commands[i + 1 + latency] += gain * speed[i]
        k.step(plant.model, plant.state, commands[i])
    width = steps // 10
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
        steps = min(60_000, int(30.0 / (found.growth_per_s * setup.step_s)))
        real = simulated_growth_per_s(setup, steps)
        away = real / found.growth_per_s - 1.0
        print(f"{name:60} {found.growth_per_s:10.4g} {real:10.4g} {away:+.1e}", flush=True)


if __name__ == "__main__":
    main("--quick" in sys.argv)
