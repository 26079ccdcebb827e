"""Search and profile a discrete key: one in whole steps, such as a latency.

Chi-square is piecewise constant in such a key. So its derivative says nothing: every value is
tried, and all other parameters are fitted at each. A value belongs to the 95 % interval where
chi-square rises by at most 3.84 above the best one.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.channel import Channel
from hertzloop.fitting.fit.free_keys import FreeKey
from hertzloop.fitting.fit.minimise import minimise
from hertzloop.fitting.fit.parameters import SHIFT_UNIT_S
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.scene.errors import SceneError

_PHASES = 6  # of a period that a search looks at
_TURNS_TRIED = 3  # solutions at other phases that are fitted with all parameters
_APART = 0.25  # of a period, between them
_FAR = 25.0  # a rise of chi-square beyond which a walk ends
_BEYOND = 2  # values in a row
_LEAST_REACH = 8  # steps
_COARSE = 10  # values of a range that a search looks at first
_FIRST_CONTACTS = 4.5  # of a record that a search looks at
CHI_SQUARE_95 = 3.841458820694124  # chi-square of one parameter at 95 %


def minimise_over_phases(problem: FitProblem, x: np.ndarray, until_s: float) -> Iterate:
    """Return the best fit over all phases, from parameters `x`.

    Where the law decides otherwise, a step of the solution cannot go on. So the most promising
    parts of a period are all tried.
    """
    if not problem.phase_periods:
        return minimise(problem, x, until_s)
    alone = replace(problem, fixed=problem.key_values(x))
    indices, places, ranked, found = problem.nuisance_indices, [], [], []
    for some in alone.clock_groups:
        part = alone.of_channels(some)
        places.append(sorted({at for i in some for at in indices[i].all}))
        iterates = minima_by_phase(part, x[places[-1]], until_s)
        ranked.append(_distinct_phases(iterates, part.phase_periods))
    for rank in range(max(len(iterates) for iterates in ranked)):
        start = x.copy()
        for iterates, at in zip(ranked, places, strict=True):
            start[at] = iterates[min(rank, len(iterates) - 1)].x
        if problem.varied_keys:
            held = replace(problem, phases_held=True)
            start = minimise(held, start, until_s, steps=8, tolerance=1e-3).x
        found.append(minimise(problem, start, until_s, steps=15, tolerance=1e-4))
    return min(found, key=lambda iterate: iterate.chi_square)


def minima_by_phase(problem: FitProblem, x: np.ndarray, until_s: float) -> list[Iterate]:
    """Return the best fits at the phases of a grid, from the best to the worst.

    Args:
        problem: of channels with one clock, and all keys held.
        x: parameters to begin with.
        until_s: end of the window after the touch, s.
    """
    part = replace(problem, phases_held=True)
    phases, found = part.phase_periods, []
    for number in range(_PHASES if phases else 1):
        start = x.copy()
        for at, period in phases.items():
            start[at] = (number + 0.5) / _PHASES * period
        found.append(minimise(part, start, until_s, steps=2, tolerance=1e-3))
    return sorted(found, key=lambda iterate: iterate.chi_square)


def _distinct_phases(iterates: list[Iterate], phases: dict[int, int]) -> list[Iterate]:
    """The best points whose phases are apart: with other parameters, a part of the period that
    looks bad may be the best."""
    found = iterates[:1]
    for iterate in iterates[1:]:
        away = [
            abs((float(iterate.x[at] - other.x[at]) + 0.5 * period) % period - 0.5 * period)
            / period
            for other in found
            for at, period in phases.items()
        ]
        if away and min(away) >= _APART and len(found) < _TURNS_TRIED:
            found.append(iterate)
    return found


@dataclass
class DiscreteProfile:
    """Chi-square at each value of a discrete key, with all other parameters fitted.

    Attributes:
        free: the key.
        costs: chi-square by number of steps.
        x: the other parameters that fit best there, (parameters,), by number of steps.
    """

    free: FreeKey
    costs: dict[int, float]
    x: dict[int, np.ndarray]

    @property
    def best(self) -> int:
        """Number of steps with the least chi-square."""
        return min(self.costs, key=lambda k: self.costs[k])

    def rise(self, k: int) -> float:
        """Return how far chi-square is above the least one."""
        return self.costs[k] - self.costs[self.best]

    @property
    def certain(self) -> list[int]:
        """The values of the 95 % interval, in steps."""
        return sorted(k for k in self.costs if self.rise(k) <= CHI_SQUARE_95)

    def interval(self) -> tuple[float | None, float | None]:
        """Return the interval in the unit of the key; None for an end that was not found.

        It is half a step wider than the values in it, as a time between two steps is fitted by one
        of them.
        """
        first, last = self.certain[0], self.certain[-1]
        low: float | None = max(0.0, (first - 0.5) * self.free.step)
        if first == min(self.costs) and first > 0:
            low = None
        return low, None if last == max(self.costs) else (last + 0.5) * self.free.step

    def spread(self, j: int, sd: float) -> tuple[float, float]:
        """Return how far the interval of parameter `j` goes down and up from the best value, over
        all certain steps; `sd`: standard deviation at one of them."""
        best = float(self.x[self.best][j])
        reach = [
            (float(self.x[k][j]) - best, sd * math.sqrt(CHI_SQUARE_95 - self.rise(k)))
            for k in self.certain
        ]
        return min(d - r for d, r in reach), max(d + r for d, r in reach)


def search_discrete_key(problem: FitProblem) -> FitProblem:
    """Return the problem with its discrete key held at the best value, and its channels with the
    phases and touches that fit best; of the other keys the starting values are used.

    Raises:
        SceneError: no value can be simulated.
    """
    f = problem.discrete_key
    keys = {g.key: g.start for g in problem.free}
    longest_s = problem.windows_s()[-1]
    contact_s = max(one.contact_s for one in problem.simulators)
    until_s = min(longest_s, _FIRST_CONTACTS * contact_s)
    if f is not None:
        until_s = min(longest_s, until_s + 1e-6 * f.high)
    tried: dict[int, tuple[float, list[np.ndarray]]] = {}

    def best_of(some: Iterable[int]) -> int:
        for k in some:
            if k not in tried:
                with suppress(SceneError):
                    tried[k] = _nuisances_at(problem, keys, k, until_s)
        if not tried:
            raise SceneError(
                "no value of the key in whole steps can be simulated. Change its range."
            )
        return min(tried, key=lambda k: tried[k][0])

    steps = range(1) if f is None else f.steps
    stride = max(1, (len(steps) - 1) // _COARSE)
    coarse = best_of(steps[::stride])
    chosen = best_of(k for k in steps if abs(k - coarse) < stride)
    alone = replace(problem, fixed=keys)
    for some, x in zip(alone.clock_groups, tried[chosen][1], strict=True):
        part = alone.of_channels(some)
        for i, c in enumerate(part.channels):
            c.phase = part.phase(x, i)
            c.touch_s, c.ppm, c.gain, c.offset = part.nuisances(x, i)
    return problem if f is None else problem.hold({f.key: chosen * f.step})


def _nuisances_at(
    problem: FitProblem, keys: dict[str, float], k: int, until_s: float
) -> tuple[float, list[np.ndarray]]:
    """Fit the nuisances with all keys held, the discrete one at a number of steps.

    Returns:
        Chi-square, and the nuisances of each group of channels with one clock. Raises SceneError.
    """
    f, late_us = problem.discrete_key, 0.0
    if f is not None:
        keys, late_us = keys | {f.key: k * f.step}, k * f.step - f.start
    alone = replace(problem, fixed=keys)
    cost, nuisances = 0.0, []
    for some in alone.clock_groups:
        part = alone.of_channels(some)
        x = part.start_vector()
        if _only_actuator_force(part.channels):
            x[0] -= late_us * 1e-6 / SHIFT_UNIT_S
        found = minima_by_phase(part, x, until_s)[0]
        cost += found.chi_square
        nuisances.append(found.x)
    return cost, nuisances


def profile_discrete_key(
    problem: FitProblem, x: np.ndarray, until_s: float
) -> tuple[FitProblem, Iterate, DiscreteProfile]:
    """Fit all other parameters at the values of the discrete key around the best one.

    Args:
        problem: with the key held at a value.
        x: parameters that fit best there.
        until_s: end of the window after the touch, s.

    Returns:
        The problem with the key held at the best value, its solution, and the profile.
    """
    f = problem.discrete_key
    assert f is not None
    iterates: dict[int, Iterate] = {}

    def tried(k: int, near: np.ndarray, late: int) -> bool:
        x = near.copy()
        for group in problem.clock_groups:
            if _only_actuator_force(problem.channels[i] for i in group):
                shift = problem.nuisance_indices[group[0]].shift
                x[shift] -= late * f.step * 1e-6 / SHIFT_UNIT_S
        try:
            iterates[k] = minimise_over_phases(problem.hold({f.key: k * f.step}), x, until_s)
        except SceneError:
            return False
        return True

    start = round(problem.fixed[f.key] / f.step)
    if not tried(start, x, 0):
        raise RecordError(f"--free {f.key}: cannot be simulated at its best value.")
    reach = max(_LEAST_REACH, start)  # farther, the key is not identifiable
    for way in (-1, 1):
        k, beyond = start + way, 0
        while k in f.steps and beyond < _BEYOND and abs(k - start) <= reach:
            if not tried(k, iterates[k - way].x, way):
                break
            least = min(iterate.chi_square for iterate in iterates.values())
            beyond = beyond + 1 if iterates[k].chi_square - least > _FAR else 0
            k += way
    costs = {k: one.chi_square for k, one in iterates.items()}
    found = DiscreteProfile(f, costs, {k: one.x for k, one in iterates.items()})
    return problem.hold({f.key: found.best * f.step}), iterates[found.best], found


def expected_profile(problem: FitProblem, iterate: Iterate) -> DiscreteProfile:
    """Return the profile of records without noise that have the readings of an iterate.

    Args:
        problem: with the discrete key held at a value.
        iterate: of this problem.
    """
    channels = [
        replace(c, value=one.predicted.reading)
        for c, one in zip(problem.channels, iterate.channels, strict=True)
    ]
    clean = replace(problem, channels=channels)
    return profile_discrete_key(clean, iterate.x, iterate.until_s)[2]


def _only_actuator_force(channels: Iterable[Channel]) -> bool:
    return all(c.record.quantity == "actuator_force" for c in channels)
