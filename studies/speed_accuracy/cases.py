"""What the speed-accuracy chart runs: the problem, and every scheme on it as a function to time."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from hertzloop.setup import load
from plant.contact.hertz import rigid_contact_time_s
from plant.numerics import phi
from plant.plant import Plant, PlantSpec
from plant.schemes.collocation import CollocationPlant
from plant.schemes.thesis2008 import ThesisPlant
from studies.speed_accuracy import integrator_kernels as ik

SAMPLE_S = 4e-6


class TooSlowError(Exception):
    """A run that was cut off; says after what."""


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


Run = Callable[[], tuple[np.ndarray, float, float]]  # gaps, energy drift, CPU time (s)


def problem(name: str, duration_s: float) -> Problem:
    """A scene with the modes that an accuracy of 1e-3 asks for, without damping."""
    spec = load(name, ["contact.damping=none", "plate.loss_factor=0.0"]).plant
    spec = replace(spec, residual_flexibility=False, lead_in_s=0.0)
    modes = CollocationPlant(spec).modes
    drive = modes.scale_per_kg * modes.contact**2
    duration_s = math.ceil(duration_s / SAMPLE_S) * SAMPLE_S
    return Problem(name, spec, duration_s, modes.omega**2, drive)


def plant_run(make: type[Plant], what: Problem, step_s: float) -> Run:
    plant = make(replace(what.spec, step_s=step_s))
    kept = [array.copy() for array in plant.state]
    every = round(SAMPLE_S / step_s)
    gaps = np.empty(what.samples)

    def run() -> tuple[np.ndarray, float, float]:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        started = time.process_time()
        ik.plant_gaps(plant.model, plant.state, every, gaps)
        cpu_s = time.process_time() - started
        return gaps.copy(), float(plant.close_balance().energy_residual), cpu_s

    return run


def kernel_run(kernel: Callable[..., None], what: Problem, step_s: float, *more: float) -> Run:
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        state, gaps = what.start(), np.empty(what.samples)
        started = time.process_time()
        kernel(state, *what.arguments, step_s, every * what.samples, every, gaps, *more)
        return gaps, what.drift(state), time.process_time() - started

    return run


def scipy_run(
    method: Any, what: Problem, tolerance: float, count: list[int], limit_s: float = math.inf
) -> Run:
    """A solver of SciPy with compiled right-hand side and Jacobian. `count[0]` becomes the number
    of evaluations. The run raises TooSlowError after `limit_s` of CPU time."""
    t = SAMPLE_S * np.arange(1, what.samples + 1)
    modes = len(what.omega2)
    more: dict[str, Any] = {}
    if method != "DOP853":
        more["jac"] = lambda t, y: ik.jacobian(y, *what.arguments)

    def run() -> tuple[np.ndarray, float, float]:
        started = time.process_time()

        def slope(time_s: float, y: np.ndarray) -> np.ndarray:
            if time.process_time() - started > limit_s:
                share = f"{time_s / t[-1]:.0%} of the time done at rtol {tolerance:g}"
                raise TooSlowError(f"stopped after {limit_s:g} s of CPU time, {share}")
            return np.asarray(ik.slope(time_s, y, *what.arguments))

        solved = solve_ivp(
            slope, (0.0, float(t[-1])), what.start(), method=method, t_eval=t,
            rtol=tolerance, atol=tolerance * 1e-6, **more,
        )  # fmt: skip
        cpu_s = time.process_time() - started
        count[0] = solved.nfev
        if not solved.success:
            raise TooSlowError(f"gave up: {solved.message}")
        plate = solved.y[:modes].sum(axis=0)
        drift = what.drift(np.ascontiguousarray(solved.y[:, -1]))
        return solved.y[2 * modes] - plate, drift, cpu_s

    return run


def cvode_run(what: Problem, tolerance: float) -> Run | None:
    """SUNDIALS CVODE, Adams with a matrix-free solver; None where scikit-sundae is missing."""
    try:
        from sksundae.cvode import CVODE
    except ImportError:
        return None
    t = SAMPLE_S * np.arange(what.samples + 1)
    modes = len(what.omega2)

    def slope(time_s: float, y: np.ndarray, out: np.ndarray) -> None:
        out[:] = ik.slope(time_s, y, *what.arguments)

    def run() -> tuple[np.ndarray, float, float]:
        solver = CVODE(
            slope, method="Adams", linsolver="gmres", rtol=tolerance, atol=1e-6 * tolerance,
            max_num_steps=100_000,
        )  # fmt: skip
        started = time.process_time()
        y = solver.solve(t, what.start()).y[1:]
        cpu_s = time.process_time() - started
        drift = what.drift(np.ascontiguousarray(y[-1]))
        return y[:, 2 * modes] - y[:, :modes].sum(axis=1), drift, cpu_s

    return run


def dop853_run(what: Problem, tolerance: float) -> Run:
    """The compiled DOP853, tolerances as SciPy's."""

    def run() -> tuple[np.ndarray, float, float]:
        state, gaps = what.start(), np.empty(what.samples)
        started = time.process_time()
        ik.dop853(
            state, *what.arguments, SAMPLE_S, gaps, tolerance, 1e-6 * tolerance, 1e-6, False
        )  # fmt: skip
        cpu_s = time.process_time() - started
        return gaps, what.drift(state), cpu_s

    return run


def quadratised_run(what: Problem, step_s: float) -> Run:
    """The non-iterative scheme; its coefficients are made before the clock starts."""
    omega = np.sqrt(what.omega2)
    change = what.drive / omega * step_s * phi(1, 1j * omega * step_s)
    turn = np.exp(1j * omega * step_s)
    table = np.ascontiguousarray([turn.real, turn.imag, change.real, change.imag])
    mass = what.spec.sphere.mass_kg
    gain = float(change.imag.sum()) + 0.5 * step_s**2 / mass
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        z, gaps = np.zeros((2, len(omega))), np.empty(what.samples)
        body = np.array([0.0, -what.spec.sphere.impact_speed_m_s, 0.0, 0.0])
        started = time.process_time()
        ik.quadratised(
            z, body, table, gain, what.spec.contact.stiffness, mass, step_s, every, gaps
        )  # fmt: skip
        cpu_s = time.process_time() - started
        state = np.concatenate([z[1], omega * z[0], body[:2]])
        return gaps, what.drift(state), cpu_s

    return run


def convolution_run(what: Problem, step_s: float) -> Run:
    """Direct sums; the Green's function is sampled before the clock starts."""
    every = round(SAMPLE_S / step_s)
    steps = every * what.samples
    omega, mass = np.sqrt(what.omega2), what.spec.sphere.mass_kg
    speed = what.spec.sphere.impact_speed_m_s
    response, force = np.zeros(steps + 1), np.zeros(steps + 1)
    ik.sampled_response(omega, what.drive, mass, step_s, response)

    def run() -> tuple[np.ndarray, float, float]:
        gaps, state = np.empty(what.samples), what.start()
        started = time.process_time()
        ik.convolution(response, force, speed, what.spec.contact.stiffness, step_s, every, gaps)
        cpu_s = time.process_time() - started
        ik.state_after(omega, what.drive, force, step_s, mass, speed, state)
        return gaps, what.drift(state), cpu_s

    return run


def collocation_run(
    what: Problem, step_s: float, stages: int, levels: int | None = None, height_m: float = 0.0
) -> Run:
    """Exponential collocation at `stages` Gauss nodes; the tables are made before the clock starts.

    `levels`: of halving; by default so many that the error of the shortest sub-step, which grows
    as its length to 2.5, falls with the order of the rest, 2 stages. The sphere starts `height_m`
    above the plate.
    """
    spec, omega = what.spec, np.sqrt(what.omega2)
    mass, stiffness = spec.sphere.mass_kg, spec.contact.stiffness
    scale_s = 0.5 * rigid_contact_time_s(mass, stiffness, spec.sphere.impact_speed_m_s)
    if levels is None:
        shrinks = (2.0 * stages / 2.5 - 1.0) * math.log2(scale_s / step_s)
        levels = 3 + max(0, math.ceil(shrinks))
    nodes = np.append(0.5 * np.polynomial.legendre.leggauss(stages)[0] + 0.5, 1.0)
    # Lagrange polynomials in powers of t/h, column j that of node j.
    powers = np.linalg.inv(np.vander(nodes[:-1], increasing=True))
    lengths = step_s * 0.5 ** np.arange(levels)
    times = np.outer(lengths, nodes)
    turns = np.empty((levels, stages + 1, 2, len(omega)))
    changes = np.empty((levels, stages, 2, len(omega)))
    gains, speed_gains = np.empty((levels, stages + 1, stages)), np.empty((levels, stages))
    for level, h in enumerate(lengths):
        for i, c in enumerate(nodes):
            x = 1j * omega * c * h
            turns[level, i] = np.exp(x).real, np.exp(x).imag
            # Change of z, and of the sphere, by (t/h)^p from 0 to c h.
            plate = [math.factorial(p) * c**p * c * h * phi(p + 1, x) for p in range(stages)]
            sphere = [c**p * (c * h) ** 2 / ((p + 1) * (p + 2)) / mass for p in range(stages)]
            answer = (what.drive / omega) * (powers.T @ np.array(plate))
            gains[level, i] = powers.T @ np.array(sphere) + answer.imag.sum(axis=1)
        changes[level, :, 0], changes[level, :, 1] = answer.real, answer.imag
        speed_gains[level] = powers.T @ (h / (1.0 + np.arange(stages))) / mass
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        z, gaps = np.zeros((2, len(omega))), np.empty(what.samples)
        speed = -spec.sphere.impact_speed_m_s
        body = np.array([height_m, speed, height_m, speed])
        started = time.process_time()
        ik.collocation(
            z, body, omega, times, turns, changes, gains, speed_gains, stiffness, scale_s, every,
            gaps,
        )  # fmt: skip
        cpu_s = time.process_time() - started
        return gaps, what.drift(np.concatenate([z[1], omega * z[0], body[:2]])), cpu_s

    return run


def thesis_run(what: Problem, step_s: float) -> Run:
    """The published scheme taken literally, with its own modes up to pi/dt."""
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        plant = ThesisPlant(replace(what.spec, step_s=step_s), every * what.samples)
        gaps = np.empty(what.samples)
        started = time.process_time()
        ik.plant_gaps(plant.model, plant.state, every, gaps)
        cpu_s = time.process_time() - started
        return gaps, float(plant.close_balance().energy_residual), cpu_s

    return run
