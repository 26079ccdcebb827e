"""Runs of every scheme on the modal equations of an impact, without control and damping.

A run integrates from the first touch on and returns the gaps at common samples, the relative change
of the energy, and the CPU time (s). All coefficients are made before its clock starts.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import dop853_kernels, gauss_kernels
from benchmarks import integrator_kernels as ik
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.plant.numerics import phi
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.scene.setup import load

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


Run = Callable[[], tuple[np.ndarray, float, float]]
Attempt = tuple[
    Callable[[], object], Callable[[], float]
]  # the work, and the energy drift after it


def problem(name: str, duration_s: float) -> Problem:
    """A scene with the modes that an accuracy of 1e-3 asks for, without damping."""
    spec = load(name, ["contact.damping=none", "plate.loss_factor=0.0"]).plant
    spec = replace(spec, residual_flexibility=False, lead_in_s=0.0)
    modes = CollocationPlant(spec).modes
    drive = modes.scale_per_kg * modes.contact**2
    duration_s = math.ceil(duration_s / SAMPLE_S) * SAMPLE_S
    return Problem(name, spec, duration_s, modes.omega**2, drive)


def _run(what: Problem, attempt: Callable[[np.ndarray], Attempt]) -> Run:
    """A run from a function that prepares an attempt, which writes the gaps."""

    def run() -> tuple[np.ndarray, float, float]:
        gaps = np.empty(what.samples)
        work, drift = attempt(gaps)
        started = time.process_time()
        work()
        cpu_s = time.process_time() - started
        return gaps, drift(), cpu_s

    return run


def plant_run(make: type[Plant], what: Problem, step_s: float) -> Run:
    """A scheme that scenes can name."""
    plant = make(replace(what.spec, step_s=step_s))
    kept = [array.copy() for array in plant.state]

    def attempt(gaps: np.ndarray) -> Attempt:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        return _of_plant(plant, step_s, gaps)

    return _run(what, attempt)


def thesis_run(what: Problem, step_s: float) -> Run:
    """The published scheme taken literally, with its own modes up to pi/dt."""

    def attempt(gaps: np.ndarray) -> Attempt:
        steps = round(SAMPLE_S / step_s) * what.samples
        return _of_plant(ThesisPlant(replace(what.spec, step_s=step_s), steps), step_s, gaps)

    return _run(what, attempt)


def _of_plant(plant: Plant, step_s: float, gaps: np.ndarray) -> Attempt:
    work = partial(ik.plant_gaps, plant.model, plant.state, round(SAMPLE_S / step_s), gaps)
    return work, lambda: float(plant.close_balance().energy_residual)


def kernel_run(kernel: Callable[..., None], what: Problem, step_s: float, *more: float) -> Run:
    """A textbook integrator."""
    every = round(SAMPLE_S / step_s)

    def attempt(gaps: np.ndarray) -> Attempt:
        state, steps = what.start(), every * what.samples
        work = partial(kernel, state, *what.arguments, step_s, steps, every, gaps, *more)
        return work, lambda: what.drift(state)

    return _run(what, attempt)


def dop853_run(what: Problem, tolerance: float) -> Run:
    """The compiled DOP853, tolerances as SciPy's."""
    settings = tolerance, 1e-6 * tolerance, 1e-6, False

    def attempt(gaps: np.ndarray) -> Attempt:
        state = what.start()
        work = partial(dop853_kernels.dop853, state, *what.arguments, SAMPLE_S, gaps, *settings)
        return work, lambda: what.drift(state)

    return _run(what, attempt)


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
            slope,
            (0.0, float(t[-1])),
            what.start(),
            method=method,
            t_eval=t,
            rtol=tolerance,
            atol=tolerance * 1e-6,
            **more,
        )
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
        return y[:, 2 * modes] - y[:, :modes].sum(axis=1), drift, cpu_s

    return run


def quadratised_run(what: Problem, step_s: float) -> Run:
    """The non-iterative scheme."""
    omega, sphere, stiffness = np.sqrt(what.omega2), what.spec.sphere, what.spec.contact.stiffness
    change = what.drive / omega * step_s * phi(1, 1j * omega * step_s)
    turn = np.exp(1j * omega * step_s)
    table = np.ascontiguousarray([turn.real, turn.imag, change.real, change.imag])
    gain = float(change.imag.sum()) + 0.5 * step_s**2 / sphere.mass_kg
    every = round(SAMPLE_S / step_s)

    def attempt(gaps: np.ndarray) -> Attempt:
        z, body = np.zeros((2, len(omega))), np.array([0.0, -sphere.impact_speed_m_s, 0.0, 0.0])
        numbers = gain, stiffness, sphere.mass_kg, step_s, every
        work = partial(ik.quadratised, z, body, table, *numbers, gaps)
        return work, lambda: what.drift(np.concatenate([z[1], omega * z[0], body[:2]]))

    return _run(what, attempt)


def convolution_run(what: Problem, step_s: float) -> Run:
    """Direct sums with the sampled Green's function."""
    every = round(SAMPLE_S / step_s)
    omega, mass = np.sqrt(what.omega2), what.spec.sphere.mass_kg
    speed, stiffness = what.spec.sphere.impact_speed_m_s, what.spec.contact.stiffness
    response, force = (np.zeros(every * what.samples + 1) for _ in range(2))
    ik.sampled_response(omega, what.drive, mass, step_s, response)

    def attempt(gaps: np.ndarray) -> Attempt:
        state = what.start()

        def drift() -> float:
            ik.state_after(omega, what.drive, force, step_s, mass, speed, state)
            return what.drift(state)

        work = partial(ik.convolution, response, force, speed, stiffness, step_s, every, gaps)
        return work, drift

    return _run(what, attempt)


def collocation_run(
    what: Problem, step_s: float, stages: int, levels: int | None = None, height_m: float = 0.0
) -> Run:
    """Exponential collocation at `stages` Gauss nodes.

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

    def attempt(gaps: np.ndarray) -> Attempt:
        z, speed = np.zeros((2, len(omega))), -spec.sphere.impact_speed_m_s
        body = np.array([height_m, speed, height_m, speed])
        tables = times, turns, changes, gains, speed_gains
        work = partial(gauss_kernels.collocation, z, body, omega, *tables)
        work = partial(work, stiffness, scale_s, every, gaps)
        return work, lambda: what.drift(np.concatenate([z[1], omega * z[0], body[:2]]))

    return _run(what, attempt)
