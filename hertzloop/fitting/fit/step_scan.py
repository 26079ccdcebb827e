"""Scan what no derivative tells of records under a law: the phase of the sampling, and a key in
whole steps, such as a latency.

Chi-square is piecewise constant in such a key, and where a law decides otherwise it jumps with the
phase. So all phases and all values of the key are tried. A value belongs to the 95 % interval where
chi-square rises by at most 3.84 above the best one.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.fitting.fit.free_keys import FreeKey
from hertzloop.fitting.fit.minimise import minimise
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.scene.errors import SceneError

_PHASES = 6  # of a period that a scan looks at
_MOST_STARTS = 3  # phases that are fitted with all parameters
_FAR = 25.0  # a rise of chi-square at two values in a row beyond which a profile ends
_LEAST_REACH = 8  # steps
_COARSE = 10  # values of a range that a scan looks at first
_FIRST_CONTACTS = 4.5  # of a record that a scan looks at
CHI_SQUARE_95 = 3.841458820694124  # chi-square of one parameter at 95 %


@dataclass
class StepProfile:
    """The best fits at each value of a key in whole steps.

    Attributes:
        free: the key.
        iterates: with all other parameters fitted, by number of steps.
    """

    free: FreeKey
    iterates: dict[int, Iterate]

    @property
    def best(self) -> int:
        """Number of steps with the least chi-square."""
        return min(self.iterates, key=lambda k: self.iterates[k].chi_square)

    def rise(self, k: int) -> float:
        """Return how far chi-square is above the least one."""
        return self.iterates[k].chi_square - self.iterates[self.best].chi_square

    @property
    def certain(self) -> list[int]:
        """The values of the 95 % interval, in steps."""
        return sorted(k for k in self.iterates if self.rise(k) <= CHI_SQUARE_95)

    def interval(self) -> tuple[float | None, float | None]:
        """Return the interval in the unit of the key; None for an end that was not found.

        It is half a step wider than the values in it, as a time between two steps is fitted by one
        of them.
        """
        first, last = self.certain[0], self.certain[-1]
        low: float | None = max(0.0, (first - 0.5) * self.free.step)
        if first == min(self.iterates) and first > 0:
            low = None
        return low, None if last == max(self.iterates) else (last + 0.5) * self.free.step

    def spread(self, j: int, sd: float) -> tuple[float, float]:
        """Return how far the interval of parameter `j` goes down and up from the best value, over
        all certain steps; `sd`: standard deviation at one of them."""
        best = self.iterates[self.best].x[j]
        reach = [
            (float(self.iterates[k].x[j] - best), sd * math.sqrt(CHI_SQUARE_95 - self.rise(k)))
            for k in self.certain
        ]
        return min(d - r for d, r in reach), max(d + r for d, r in reach)


def scan_steps(problem: FitProblem) -> tuple[FitProblem, np.ndarray]:
    """Return the problem with its key in whole steps held at the best value, and parameters with
    the phases that fit best there; the other keys keep their starting values.

    Raises:
        SceneError: no value can be simulated.
    """
    f, longest_s = problem.discrete_key, problem.windows_s()[-1]
    contact_s = max(one.contact_s for one in problem.simulators)
    until_s = _FIRST_CONTACTS * contact_s + (1e-6 * f.high if f else 0.0)
    tried: dict[int, tuple[float, FitProblem, np.ndarray]] = {}

    def look(some: Iterable[int]) -> int:
        for k in some:
            held = problem.hold({f.key: k * f.step}) if f else problem
            with suppress(SceneError):
                x = held.start_vector()
                cost, starts = _scan_phases(held, x, min(longest_s, until_s))
                tried[k] = cost, held, starts[0]
        if not tried:
            raise SceneError(
                "no value of the key in whole steps can be simulated. Change its range."
            )
        return min(tried, key=lambda k: tried[k][0])

    steps = f.steps if f else range(1)
    stride = max(1, (len(steps) - 1) // _COARSE)
    coarse = look(steps[::stride])
    best = look(k for k in steps if 0 < abs(k - coarse) < stride)
    return tried[best][1:]


def profile_steps(
    problem: FitProblem, x: np.ndarray, until_s: float
) -> tuple[FitProblem, StepProfile]:
    """Fit all other parameters at the values of the key in whole steps around the present one.

    Args:
        problem: with the key held at a value.
        x: parameters that fit best there.
        until_s: end of the window after the touch, s.

    Returns:
        The problem with the key held at the best value, and the profile.
    """
    f = problem.discrete_key
    assert f is not None
    start = round(problem.fixed[f.key] / f.step)
    profile = StepProfile(f, {start: fit_phases(problem, x, until_s)})
    reach = max(_LEAST_REACH, start)  # farther, the key is not identifiable
    for way in (-1, 1):
        k = start + way
        while k in f.steps and abs(k - start) <= reach:
            held, near = problem.hold({f.key: k * f.step}), profile.iterates[k - way].x
            try:
                profile.iterates[k] = fit_phases(held, near, until_s)
            except SceneError:
                break
            if min(profile.rise(k), profile.rise(k - way)) > _FAR:
                break
            k += way
    return problem.hold({f.key: profile.best * f.step}), profile


def expected_profile(problem: FitProblem, iterate: Iterate) -> StepProfile:
    """Return the profile of records without noise that have the readings of an iterate.

    Args:
        problem: with the key in whole steps held at a value.
        iterate: of this problem.
    """
    channels = [
        replace(c, value=one.predicted.reading)
        for c, one in zip(problem.channels, iterate.channels, strict=True)
    ]
    return profile_steps(replace(problem, channels=channels), iterate.x, iterate.until_s)[1]


def fit_phases(problem: FitProblem, x: np.ndarray, until_s: float) -> Iterate:
    """Return the best fit over all phases, from parameters `x`."""
    if not problem.phase_periods:
        return minimise(problem, x, until_s)
    found, held = [], replace(problem, phases_held=True)
    for one in _scan_phases(problem, x, until_s)[1]:
        if problem.varied_keys:
            one = minimise(held, one, until_s, steps=8, tolerance=1e-3).x
        found.append(minimise(problem, one, until_s, steps=15, tolerance=1e-4))
    return min(found, key=lambda iterate: iterate.chi_square)


def _scan_phases(
    problem: FitProblem, x: np.ndarray, until_s: float
) -> tuple[float, list[np.ndarray]]:
    """Fit the nuisances at the phases of a grid, with all keys held at those of `x`.

    Returns:
        The least chi-square, and parameters at the most promising phases, the best first.
    """
    n = len(problem.varied_keys)
    held = replace(problem, fixed=problem.key_values(x), phases_held=True)
    clocks: dict[int, list[int]] = {}
    for index, at in enumerate(held.nuisance_indices):
        clocks.setdefault(at.shift, []).append(index)
    tried = []
    for number in range(_PHASES):
        start = x[n:].copy()
        for place, period in held.phase_periods.items():
            start[place] = (number + 0.5) / _PHASES * period
        tried.append(minimise(held, start, until_s, steps=4, tolerance=1e-3))
    starts, cost, distinct = [x.copy() for _ in range(_MOST_STARTS)], 0.0, 1
    for channels in clocks.values():
        costs = [
            sum(float(np.sum(one.residual[one.channels[i].rows] ** 2)) for i in channels)
            for one in tried
        ]
        cost += min(costs)
        apart: list[int] = []  # the best phases that are no neighbours
        for i in sorted(range(_PHASES), key=lambda i: costs[i]):
            if all((i - other) % _PHASES not in (1, _PHASES - 1) for other in apart):
                apart.append(i)
        distinct = max(distinct, len(apart))
        places = sorted({place for i in channels for place in held.nuisance_indices[i].all})
        for rank, one in enumerate(starts):
            best = tried[apart[min(rank, len(apart) - 1)]]
            one[[n + place for place in places]] = best.x[places]
    return cost, starts[:distinct]
