"""The closed loop over gain and latency: where the actuator feeds energy in."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.scenes import load
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in

_KAPPAS = np.linspace(0.0, 2.0, 21)
_LATENCIES_US = np.arange(0, 61, 3)


@dataclass(frozen=True)
class LoopPoint:
    """First impact with the law at one gain and latency: energies over the impact's energy."""

    kappa: float
    latency_us: float
    injected: float
    plate_energy_db: float  # against no control
    contact_us: float


def loop_map(name: str = "aluminium-3mm", every: int = 1) -> Iterator[LoopPoint]:
    """The slope-threshold law's first impact over gain and latency; `every`: take each n-th gain
    and latency only."""
    lasts = "run.duration_s=0.0016"
    off = load(name, [lasts, "controller.law=off"])
    free = impacts_in(off.plant, simulate(off).truth)[0]
    for kappa in _KAPPAS[::every]:
        for latency_us in _LATENCIES_US[::every]:
            keys = [f"controller.kappa={kappa:.3f}", f"controller.latency_us={latency_us}"]
            setup = load(name, [lasts, *keys])
            truth = simulate(setup)
            first = impacts_in(setup.plant, truth.truth)[0]
            yield LoopPoint(
                float(kappa),
                float(latency_us),
                truth.balance.injected_j / truth.balance.energy_start_j,
                10.0 * math.log10(first.plate_energy_j / free.plate_energy_j),
                1e6 * first.duration_s,
            )
