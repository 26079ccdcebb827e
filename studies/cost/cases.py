"""What a case of a sweep costs on one core, and how much of that is the compiled loop."""

import random
import statistics
import time
from dataclasses import dataclass

from hertzloop.loop.compiled import IN_LOOP
from hertzloop.setup import load
from studies.sweeps.design import Kind, make_design
from studies.sweeps.evaluate import run_cases

_SWEEPS: dict[str, tuple[Kind, list[str]]] = {
    "latency map": ("grid", ["controller.latency_us=0:99:1", "sensors.bits=8:23:1"]),
    "radius, thickness, material (Sobol)": (
        "sobol",
        ["sphere.radius_m=0.001:0.006", "plate.thickness_m=0.001:0.006",
         "plate.material=aluminium,steel,glass"],
    ),
}  # fmt: skip
_CASES = {"grid": 200, "sobol": 16}  # a round


@dataclass(frozen=True)
class CaseCost:
    """Processor time of a case and of the loop in it, ms; medians of the rounds."""

    sweep: str
    case_ms: float
    loop_ms: float


def measure(rounds: int) -> list[CaseCost]:
    """Costs of the latency map of `aluminium-3mm` and of other plants, of new cases each round."""
    scene, found = load("aluminium-3mm"), []
    for sweep, (kind, over) in _SWEEPS.items():
        count, whole, loop = _CASES[kind], [], []
        cases = make_design(scene, over, kind, (rounds + 1) * count, seed=1).cases()
        random.Random(1).shuffle(cases)
        for turn in range(rounds + 1):
            some = cases[turn * count % len(cases) :][:count]
            numbered = list(enumerate(some))
            started = time.thread_time()
            list(run_cases(scene, "impact", numbered))
            took_s = time.thread_time() - started
            IN_LOOP.seconds, IN_LOOP.running = 0.0, True
            list(run_cases(scene, "impact", numbered))
            IN_LOOP.running = False
            if turn:  # the first loads what is compiled
                whole.append(1e3 * took_s / len(some))
                loop.append(1e3 * IN_LOOP.seconds / len(some))
        found.append(CaseCost(sweep, statistics.median(whole), statistics.median(loop)))
    return found
