"""Search and profile a key in whole steps, such as a latency.

Chi-square is piecewise constant in such a key. So its derivative says nothing: every value is
tried, and all other parameters are fitted at each. A value belongs to the 95 % interval where
chi-square rises by at most 3.84 above the best one.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.free_keys import FreeKey, step_range
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.phases import (
    clock_groups,
    minima_by_phase,
    minimise_over_phases,
    subproblem,
)
from hertzloop.identification.fit.problem import SHIFT_UNIT_S, FitProblem
from hertzloop.identification.records.errors import RecordError
from hertzloop.scene.errors import SceneError

_FAR = 25.0  # a rise of chi-square beyond which a walk ends
_BEYOND = 2  # values in a row
_LEAST_REACH = 8  # steps
_COARSE = 10  # values of a range that a search looks at first
_FIRST_CONTACTS = 4.5  # of a record that a search looks at
CHI_SQUARE_95 = 3.841458820694124  # chi-square of one parameter at 95 %


@dataclass
class StepProfile:
    """What a record says of a key in whole steps.

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
        resolution = self.free.resolution or 1.0
        first, last = self.certain[0], self.certain[-1]
        low: float | None = max(0.0, (first - 0.5) * resolution)
        if first == min(self.costs) and first > 0:
            low = None
        return low, None if last == max(self.costs) else (last + 0.5) * resolution

    def spread(self, j: int, sd: float) -> tuple[float, float]:
        """Return how far the interval of parameter `j` goes down and up from the best value, over
        all certain steps; `sd`: standard deviation at one of them."""
        best = float(self.x[self.best][j])
        reach = [
            (float(self.x[k][j]) - best, sd * math.sqrt(CHI_SQUARE_95 - self.rise(k)))
            for k in self.certain
        ]
        return min(d - r for d, r in reach), max(d + r for d, r in reach)


def search_whole_steps(problem: FitProblem) -> FitProblem:
    """Return the problem with its key in whole steps held at the best value, and its channels with
    the phases and touches that fit best; of the other keys the starting values are used.

    Raises:
        SceneError: no value can be simulated.
    """
    f = problem.whole_step_key
    keys = {g.key: g.start for g in problem.free}
    longest_s = problem.windows_s()[-1]
    contact_s = max(m.contact_s for m in problem.models)
    until_s = min(longest_s, _FIRST_CONTACTS * contact_s)
    if f is not None:
        until_s = min(longest_s, until_s + 1e-6 * f.high)
    tried: dict[int, tuple[float, list[np.ndarray]]] = {}
    first, last = (0, 0) if f is None else step_range(f)
    stride = max(1, (last - first) // _COARSE)
    for k in range(first, last + 1, stride):
        with suppress(SceneError):
            tried[k] = _nuisances_at(problem, keys, k, until_s)
    if not tried:
        raise SceneError("no value of the key in whole steps can be simulated. Change its range.")
    coarse = min(tried, key=lambda k: tried[k][0])
    for k in range(max(first, coarse - stride + 1), min(last, coarse + stride - 1) + 1):
        if k not in tried:
            with suppress(SceneError):
                tried[k] = _nuisances_at(problem, keys, k, until_s)
    chosen = min(tried, key=lambda k: tried[k][0])
    alone = replace(problem, fixed=keys)
    for some, x in zip(clock_groups(alone), tried[chosen][1], strict=True):
        part = subproblem(alone, some)
        for i, c in enumerate(part.channels):
            c.phase = part.phase(x, i)
            c.touch_s, c.ppm, c.gain, c.offset = part.nuisances(x, i)
    if f is None:
        return problem
    return replace(problem, fixed=problem.fixed | {f.key: chosen * (f.resolution or 1.0)})


def _nuisances_at(
    problem: FitProblem, keys: dict[str, float], k: int, until_s: float
) -> tuple[float, list[np.ndarray]]:
    """Fit the nuisances with all keys held, that in whole steps at a number of steps.

    Returns:
        Chi-square, and the nuisances of each group of channels with one clock. Raises SceneError.
    """
    f, late_us = problem.whole_step_key, 0.0
    if f is not None:
        value = k * (f.resolution or 1.0)
        keys, late_us = keys | {f.key: value}, value - f.start
    alone = replace(problem, fixed=keys)
    cost, nuisances = 0.0, []
    for some in clock_groups(alone):
        x = subproblem(alone, some).start_vector()
        if _only_actuator_force(alone.channels[i] for i in some):
            x[0] -= late_us * 1e-6 / SHIFT_UNIT_S
        found = minima_by_phase(alone, some, x, until_s)[0]
        cost += found.chi_square
        nuisances.append(found.x)
    return cost, nuisances


def profile_whole_steps(
    problem: FitProblem, iterate: Iterate, until_s: float
) -> tuple[FitProblem, Iterate, StepProfile]:
    """Fit all other parameters at the values of the key in whole steps around the best one.

    Args:
        problem: with the key held at a value.
        iterate: its solution there.
        until_s: end of the window after the touch, s.

    Returns:
        The problem with the key held at the best value, its solution, and the profile.
    """
    f = problem.whole_step_key
    assert f is not None
    resolution = f.resolution or 1.0
    lowest, highest = step_range(f)
    iterates: dict[int, Iterate] = {}

    def at(k: int) -> FitProblem:
        return replace(problem, fixed=problem.fixed | {f.key: k * resolution})

    def tried(k: int, near: Iterate, late: int) -> bool:
        held = at(k)
        x = near.x.copy()
        for group in clock_groups(problem):
            if _only_actuator_force(problem.channels[i] for i in group):
                shift = problem.nuisance_indices[group[0]].shift
                x[shift] -= late * resolution * 1e-6 / SHIFT_UNIT_S
        try:
            iterates[k] = minimise_over_phases(held, x, until_s)
        except SceneError:
            return False
        return True

    start = round(problem.fixed[f.key] / resolution)
    if not tried(start, iterate, 0):
        raise RecordError(f"--free {f.key}: cannot be simulated at its best value.")
    reach = max(_LEAST_REACH, start)  # farther, the key is not identifiable
    for way in (-1, 1):
        k, beyond = start + way, 0
        while lowest <= k <= highest and beyond < _BEYOND and abs(k - start) <= reach:
            if not tried(k, iterates[k - way], way):
                break
            least = min(iterate.chi_square for iterate in iterates.values())
            beyond = beyond + 1 if iterates[k].chi_square - least > _FAR else 0
            k += way
    costs = {k: one.chi_square for k, one in iterates.items()}
    found = StepProfile(f, costs, {k: one.x for k, one in iterates.items()})
    return at(found.best), iterates[found.best], found


def expected_profile(problem: FitProblem, iterate: Iterate, until_s: float) -> StepProfile:
    """The profile of a record without noise that has the values of a point.

    Args:
        problem: with the key held at a value.
        iterate: where.
        until_s: end of the window after the touch, s.
    """
    channels = []
    for index, c in enumerate(problem.channels):
        predicted = problem.predict(iterate.x, index, until_s)
        channels.append(replace(c, value=predicted.reading))
    clean = replace(problem, channels=channels)
    return profile_whole_steps(clean, iterate, until_s)[2]


def _only_actuator_force(channels: Iterable[Channel]) -> bool:
    return all(c.record.quantity == "actuator_force" for c in channels)
