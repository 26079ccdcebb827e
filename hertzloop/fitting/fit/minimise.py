"""Minimise the squared residuals of a fit: its start, damped steps, and a lower minimum."""

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import scipy

from hertzloop.fitting.fit.free_keys import PRESSURE_KEY, FreeKey, drop_values, values_for_record
from hertzloop.fitting.fit.parameters import SHIFT_UNIT_S
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.scene.errors import SceneError

# Sizes of a first step: of logarithms of keys, of shifts (contact times), of phases (periods), of
# clocks (ppm), of all others.
_KEY_SIZE, _SHIFT_SIZE, _PHASE_SIZE, _CLOCK_SIZE, _LARGEST = 0.3, 0.1, 0.1, 50.0, 1.0
_INSIDE = 0.1  # least distance of a start from a bound, over a first step; nearer, steps are short
_STILL = 1e-7  # a step over its size, that ends a minimisation
_PRESSURES = (0.25, 0.45, 0.7)  # starts, over the elastic pressure, above which nothing yields
# The search for a lower minimum goes along the direction that a shorter window tells least.
_BROADER = 8.0  # least standard deviation of a shorter window, over that of the whole record
_REACH_SD, _FARTHEST = 4.0, 0.4  # reach: deviations of the shorter window; logarithms of the keys
_STEP_SD = 10.0  # step: standard deviations of the whole record
_MOST_STEPS = 20  # on each side
_LOWER = 4.0  # least fall of chi-square
_HERE = 1e-9  # deviations: so near, a point of the search is its beginning


def minimise(
    problem: FitProblem,
    x: np.ndarray,
    until_s: float,
    early: bool = False,
    steps: int = 40,
    tolerance: float = 1e-7,
) -> Iterate:
    """Minimise the squared residuals within the bounds of the keys.

    Args:
        problem: what is fitted.
        x: where to start.
        until_s: end of the window after the touch, s. The samples in it at the start are fitted.
        early: whether weak priors hold the keys near their start.
        steps: most steps.
        tolerance: relative fall of chi-square that ends it.

    Returns:
        The best point found, with its Jacobian.
    """
    low, high = problem.bounds()
    size = _step_sizes(problem, x)
    inside = _INSIDE * np.minimum(size, high - low)
    x = np.clip(x, low + inside, high - inside)
    window = problem.samples_until(x, until_s)
    found = problem.evaluate(x, until_s, early, window=window)

    def residual(z: np.ndarray) -> np.ndarray:
        try:
            moved = problem.evaluate(x + size * z, until_s, early, jacobian=False, window=window)
        except SceneError:  # a value that the scene refuses
            return np.full(len(found.residual), np.inf)
        return moved.residual

    def jacobian(z: np.ndarray) -> np.ndarray:
        return size * problem.evaluate(x + size * z, until_s, early, window=window).jacobian

    ended = scipy.optimize.least_squares(
        residual,
        np.zeros(len(x)),
        jacobian,
        ((low - x) / size, (high - x) / size),
        ftol=tolerance,
        xtol=_STILL,
        max_nfev=2 * steps,
    )
    return problem.evaluate(x + size * ended.x, until_s, early, window=window)


def _step_sizes(problem: FitProblem, x: np.ndarray) -> np.ndarray:
    """Largest first steps: beyond, derivatives mean little."""
    found = np.full(len(x), _LARGEST)
    found[: len(problem.varied_keys)] = _KEY_SIZE
    for place, period in problem.phase_periods.items():
        found[place] = _PHASE_SIZE * period
    for simulator, at in zip(problem.simulators, problem.nuisance_indices, strict=True):
        found[at.shift] = _SHIFT_SIZE * simulator.contact_s / SHIFT_UNIT_S
        found[at.clock] = _CLOCK_SIZE
    return found


def best_start(problem: FitProblem, x: np.ndarray) -> np.ndarray:
    """Return the starting parameters, (parameters,), by those of `start_vector` or of a scan.

    Several values of a limiting pressure are tried, as its gradient is zero above the elastic
    pressure of the impact.
    """
    keys = [f.key for f in problem.varied_keys]
    if PRESSURE_KEY not in keys:
        return x
    place = keys.index(PRESSURE_KEY)
    f = problem.varied_keys[place]
    pressure = _elastic_pressure(problem, f)
    end = problem.windows_s()[0]
    found = []
    for share in _PRESSURES:
        tried = x.copy()
        tried[place] = math.log(min(max(share * pressure, 1.01 * f.low), 0.99 * f.high))
        found.append(minimise(problem, tried, end, early=True, steps=12, tolerance=1e-2))
    return min(found, key=lambda iterate: iterate.chi_square).x


def search_lower_minimum(
    problem: FitProblem, iterate: Iterate, shorter: Sequence[Iterate]
) -> Iterate:
    """Return the iterate, or one with a lower chi-square in another basin, by one restart.

    Waves that come back from the edges repeat: shifted by a period, they fit almost as well, and
    which of these minima a growing window comes to is chance.

    Args:
        problem: the fit.
        iterate: solution of the whole records.
        shorter: solutions of shorter windows, the shortest first.
    """
    keys, until_s = len(problem.varied_keys), iterate.until_s
    known = np.linalg.pinv(iterate.covariance()[:keys, :keys])
    for window in reversed(shorter):
        covariance = problem.evaluate(iterate.x, window.until_s, early=True).covariance()
        variances, directions = np.linalg.eigh(covariance[:keys, :keys])
        direction, sd = directions[:, -1], math.sqrt(max(float(variances[-1]), 1e-30))
        apart = 1.0 / math.sqrt(max(float(direction @ known @ direction), 1e-30))
        if not sd > _BROADER * apart:
            continue
        axis = covariance[:, :keys] @ direction / sd  # of all parameters
        reach = min(_REACH_SD, _FARTHEST / sd)
        count = min(math.ceil(reach * sd / (_STEP_SD * apart)), _MOST_STEPS)
        line = []
        for t in np.linspace(-reach, reach, 2 * count + 1):
            with suppress(SceneError):  # a value that the scene refuses
                moved = problem.evaluate(iterate.x + t * axis, until_s, jacobian=False)
                line.append((moved.chi_square, float(t)))
        minima = [
            (chi, t)
            for (left, _), (chi, t), (right, _) in zip(line, line[1:], line[2:], strict=False)
            if chi <= min(left, right) and abs(t) > _HERE
        ]
        if minima:
            x = iterate.x + min(minima)[1] * axis
            found = minimise(problem, x, until_s, steps=15, tolerance=1e-3)
            if found.chi_square < iterate.chi_square - _LOWER:
                return found
        break
    return iterate


def _elastic_pressure(problem: FitProblem, f: FreeKey) -> float:
    """Return the pressure in the centre of an elastic contact at its largest force, Pa, in the
    first record."""
    simulator = problem.simulators[0]
    starts = {g.key: g.start for g in problem.free}
    values = drop_values(values_for_record(starts, problem.channels[0].record))
    run = simulator.run(values | {f.key: 1e13}, 2.0 * simulator.contact_s)
    force = float(np.max(run.force_n(run.time_s)))
    bodies = simulator.setup.vary(values).mechanics
    radius = bodies.sphere.radius_m
    modulus = 0.75 * run.contact.stiffness / math.sqrt(radius)
    a = (0.75 * force * radius / modulus) ** (1.0 / 3.0)
    return 1.5 * force / (math.pi * a * a)
