"""Runs of schemes and solvers on the modal equations of an impact, without control and damping.

A run integrates from the first touch on. All coefficients are made before its clock starts.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import integrator_kernels as ik
from benchmarks.scenes import load
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant

SAMPLE_S = 4e-6


@dataclass
class Problem:
    """Modal equations of one scene: arrays (modes,), duration a multiple of the samples."""

    name: str
    spec: PlantSpec
    duration_s: float
    omega2: np.ndarray
    drive: np.ndarray

    @property
    def samples(self) -> int:
        """Number of samples of the gap."""
        return round(self.duration_s / SAMPLE_S)

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What the integrators' kernels take after the state."""
        spec = self.spec
        return self.omega2, self.drive, spec.contact.stiffness, spec.sphere.mass_kg

    def start(self) -> np.ndarray:
        """State at the first touch."""
        state = np.zeros(2 * len(self.omega2) + 2)
        state[-1] = -self.spec.sphere.impact_speed_m_s
        return state

    def drift(self, state: np.ndarray) -> float:
        """Relative change of the energy since the start."""
        begin = float(ik.energy(self.start(), *self.arguments))
        return float(ik.energy(state, *self.arguments)) / begin - 1.0


class Solution(NamedTuple):
    """What a run returns: the gap at the samples (m), the relative change of the energy, CPU time,
    and the evaluations of the right-hand side where a solver counts them."""

    gaps: np.ndarray
    energy_drift: float
    cpu_s: float
    evaluations: int = 0


Run = Callable[[], Solution]


def problem(name: str, duration_s: float) -> Problem:
    """A scene with the modes that an accuracy of 1e-3 asks for, without damping."""
    spec = load(name, ["contact.damping=none", "plate.loss_factor=0.0"]).plant
    spec = replace(spec, residual_flexibility=False, lead_in_s=0.0)
    modes = ModalPlant(spec).modes
    drive = modes.scale_per_kg * modes.contact**2
    duration_s = math.ceil(duration_s / SAMPLE_S) * SAMPLE_S
    return Problem(name, spec, duration_s, modes.omega**2, drive)


def plant_run(make: type[Plant], what: Problem, step_s: float) -> Run:
    """A scheme of a plant."""
    plant = make(replace(what.spec, step_s=step_s))
    kept = [array.copy() for array in plant.state]

    def run() -> Solution:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        gaps = np.empty(what.samples)
        started = time.process_time()
        ik.plant_gaps(plant.model, plant.state, round(SAMPLE_S / step_s), gaps)
        cpu_s = time.process_time() - started
        return Solution(gaps, float(plant.close_balance().energy_residual), cpu_s)

    return run


def kernel_run(kernel: Callable[..., None], what: Problem, step_s: float) -> Run:
    """A textbook integrator."""
    every = round(SAMPLE_S / step_s)

    def run() -> Solution:
        gaps, state = np.empty(what.samples), what.start()
        started = time.process_time()
        kernel(state, *what.arguments, step_s, every * what.samples, every, gaps)
        return Solution(gaps, what.drift(state), time.process_time() - started)

    return run


def dop853_run(what: Problem, tolerance: float) -> Run:
    """SciPy's DOP853 with a compiled right-hand side."""
    t = SAMPLE_S * np.arange(1, what.samples + 1)
    modes = len(what.omega2)

    def run() -> Solution:
        started = time.process_time()
        solved = solve_ivp(
            ik.slope,
            (0.0, float(t[-1])),
            what.start(),
            method="DOP853",
            t_eval=t,
            args=what.arguments,
            rtol=tolerance,
            atol=1e-6 * tolerance,
        )
        cpu_s = time.process_time() - started
        gaps = solved.y[2 * modes] - solved.y[:modes].sum(axis=0)
        drift = what.drift(np.ascontiguousarray(solved.y[:, -1]))
        return Solution(gaps, drift, cpu_s, solved.nfev)

    return run


def cvode_run(what: Problem, tolerance: float) -> Run:
    """SUNDIALS CVODE, Adams with a matrix-free solver. Raises ImportError where scikit-sundae is
    missing."""
    from sksundae.cvode import CVODE

    t = SAMPLE_S * np.arange(what.samples + 1)
    modes = len(what.omega2)

    def slope(time_s: float, y: np.ndarray, out: np.ndarray) -> None:
        out[:] = ik.slope(time_s, y, *what.arguments)

    def run() -> Solution:
        solver = CVODE(
            slope,
            method="Adams",
            linsolver="gmres",
            rtol=tolerance,
            atol=1e-6 * tolerance,
            max_num_steps=100_000,
        )
        started = time.process_time()
        y = solver.solve(t, what.start()).y[1:]
        cpu_s = time.process_time() - started
        drift = what.drift(np.ascontiguousarray(y[-1]))
        return Solution(y[:, 2 * modes] - y[:, :modes].sum(axis=1), drift, cpu_s)

    return run
