"""Stability limits of the textbook integrators, found by running their kernels."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks import integrator_kernels as ik

TEXTBOOK: dict[str, Callable[..., None]] = {"verlet": ik.verlet, "rk4": ik.rk4}
LIMITS = {"verlet": 2.0, "rk4": 2.0 * math.sqrt(2.0)}  # of w h, for a free vibration


def growth_per_step(scheme: str, phase: float) -> float:
    """Factor by which a free vibration with w h = `phase` grows in a step: the largest
    eigenvalue of the step from (q, q'/w) to the next."""

    def after(q: float, v: float) -> np.ndarray:
        y = np.array([q, v * phase, 1e9, 0.0])  # the sphere is far away
        omega2, drive = np.array([phase * phase]), np.array([1.0])
        TEXTBOOK[scheme](y, omega2, drive, 1.0, 1.0, 1.0, 1, 1, np.empty(1))
        return np.array([y[0], y[1] / phase])

    matrix = np.column_stack([after(1.0, 0.0), after(0.0, 1.0)])
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def growth(every: int = 1) -> Iterator[tuple[str, float, float]]:
    """Scheme, w h, growth per step; `every`: take each n-th step only."""
    for scheme in TEXTBOOK:
        for phase in np.arange(0.05, 4.0, 0.05)[::every]:
            yield scheme, float(phase), growth_per_step(scheme, float(phase))
