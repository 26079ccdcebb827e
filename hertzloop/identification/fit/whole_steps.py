"""Search and profile a key in whole steps, and the sampling phases of records under a law.

Chi-square is piecewise constant in a latency, which counts whole steps. So its derivative says
nothing: every value is tried, and all other parameters are fitted at each. A value belongs to the
95 % interval where chi-square rises by at most 3.84 above the best one.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.free_keys import FreeKey, step_range
from hertzloop.identification.fit.minimise import minimise
from hertzloop.identification.fit.problem import SHIFT_UNIT_S, FitProblem, Iterate
from hertzloop.identification.records.errors import RecordError
from hertzloop.scene.errors import SceneError

_PHASES = 6  # of a period that a search looks at
_TURNS_TRIED = 3  # solutions at other phases that are fitted with all parameters
_APART = 0.25  # of a period, between them
_FAR = 25.0  # a rise of chi-square beyond which a walk ends
_BEYOND = 2  # values in a row
_LEAST_REACH = 8  # steps
_COARSE = 10  # values of a range that a search looks at first
_FIRST_CONTACTS = 4.5  # of a record that a search looks at


@dataclass
class StepProfile:
    """What a record says of a key in whole steps: by number of steps, chi-square and the other
    parameters that fit best there."""

    free: FreeKey
    costs: dict[int, float]
    x: dict[int, np.ndarray]

    @property
    def best(self) -> int:
        """Number of steps with the least chi-square."""
        return min(self.costs, key=lambda k: self.costs[k])

    def rise(self, k: int) -> float:
        """How far chi-square is above the least one."""
        return self.costs[k] - self.costs[self.best]

    @property
    def certain(self) -> list[int]:
        """The values of the 95 % interval, in steps."""
        return sorted(k for k in self.costs if self.rise(k) <= CHI_SQUARE_95)

    def interval(self) -> tuple[float | None, float | None]:
        """The interval in the unit of the key, half a step wider than the values in it: a time
        between two steps is fitted by one of them. An end that was not found is open."""
        resolution = self.free.resolution or 1.0
        first, last = self.certain[0], self.certain[-1]
        low: float | None = max(0.0, (first - 0.5) * resolution)
        if first == min(self.costs) and first > 0:
            low = None
        return low, None if last == max(self.costs) else (last + 0.5) * resolution

    def spread(self, j: int, sd: float) -> tuple[float, float]:
        """How far the interval of parameter `j` goes down and up from the best value, over all
        certain steps; `sd`: standard deviation at one of them."""
        best = float(self.x[self.best][j])
        reach = [
            (float(self.x[k][j]) - best, sd * math.sqrt(CHI_SQUARE_95 - self.rise(k)))
            for k in self.certain
        ]
        return min(d - r for d, r in reach), max(d + r for d, r in reach)


CHI_SQUARE_95 = 3.841458820694124  # chi-square of one parameter at 95 %


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

    def look(k: int) -> None:
        late_us = 0.0 if f is None else k * (f.resolution or 1.0) - f.start
        held = keys if f is None else keys | {f.key: k * (f.resolution or 1.0)}
        alone = replace(problem, fixed=held, evaluations=0)
        cost, places = 0.0, []
        for some in _clock_groups(alone):
            x = _subproblem(alone, some).start_vector()
            if _only_actuator_force(alone.channels[i] for i in some):
                x[0] -= late_us * 1e-6 / SHIFT_UNIT_S
            found = _minima_by_phase(alone, some, x, until_s)[0]
            cost += found.chi_square
            places.append(found.x)
        tried[k] = cost, places
        problem.evaluations += alone.evaluations

    first, last = (0, 0) if f is None else step_range(f)
    stride = max(1, (last - first) // _COARSE)
    for k in range(first, last + 1, stride):
        with suppress(SceneError):
            look(k)
    if not tried:
        raise SceneError("no value of the key in whole steps can be simulated. Change its range.")
    coarse = min(tried, key=lambda k: tried[k][0])
    for k in range(max(first, coarse - stride + 1), min(last, coarse + stride - 1) + 1):
        if k not in tried:
            with suppress(SceneError):
                look(k)
    chosen = min(tried, key=lambda k: tried[k][0])
    alone = replace(problem, fixed=keys)
    for some, x in zip(_clock_groups(alone), tried[chosen][1], strict=True):
        part = _subproblem(alone, some)
        for i, c in enumerate(part.channels):
            c.phase = part.phase(x, i)
            c.touch_s, c.ppm, c.gain, c.offset = part.nuisances(x, i)
    if f is None:
        return problem
    return replace(problem, fixed=problem.fixed | {f.key: chosen * (f.resolution or 1.0)})


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
        return replace(problem, fixed=problem.fixed | {f.key: k * resolution}, evaluations=0)

    def tried(k: int, near: Iterate, late: int) -> bool:
        held = at(k)
        x = near.x.copy()
        for group in _clock_groups(problem):
            if _only_actuator_force(problem.channels[i] for i in group):
                shift = problem.nuisance_indices[group[0]].shift
                x[shift] -= late * resolution * 1e-6 / SHIFT_UNIT_S
        try:
            iterates[k] = minimise_over_phases(held, x, until_s)
        except SceneError:
            return False
        finally:
            problem.evaluations += held.evaluations
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
    best = at(found.best)
    best.evaluations = problem.evaluations
    return best, iterates[found.best], found


def expected_profile(problem: FitProblem, iterate: Iterate, until_s: float) -> StepProfile:
    """The profile of a record without noise that has the values of a point.

    Args:
        problem: with the key held at a value.
        iterate: where.
        until_s: end of the window after the touch, s.
    """
    channels = []
    for index, c in enumerate(problem.channels):
        value, _, _ = problem.predict(iterate.x, index, until_s)
        _, _, gain, offset = problem.nuisances(iterate.x, index)
        channels.append(replace(c, value=gain * value + offset))
    clean = replace(problem, channels=channels, evaluations=0)
    found = profile_whole_steps(clean, iterate, until_s)[2]
    problem.evaluations += clean.evaluations
    return found


def minimise_over_phases(problem: FitProblem, x: np.ndarray, until_s: float) -> Iterate:
    """The best fit from a point over all phases: where the law decides otherwise, a step of the
    solution cannot go on, so the most promising parts of a period are all tried."""
    if not problem.phase_periods:
        return minimise(problem, x, until_s, early=False)
    alone = replace(problem, fixed=problem.key_values(x), evaluations=0)
    keys = len(problem.varied_keys)
    groups = _clock_groups(alone)
    places = [
        sorted({at for i in some for at in problem.nuisance_indices[i].all}) for some in groups
    ]
    ranked = [
        _distinct_phases(
            _minima_by_phase(alone, some, x[at], until_s), _subproblem(alone, some).phase_periods
        )
        for some, at in zip(groups, places, strict=True)
    ]
    problem.evaluations += alone.evaluations
    found = []
    for rank in range(max(len(iterates) for iterates in ranked)):
        start = x.copy()
        for iterates, at in zip(ranked, places, strict=True):
            start[at] = iterates[min(rank, len(iterates) - 1)].x
        held = replace(problem, phases_held=True, evaluations=0)
        near = (
            minimise(held, start, until_s, early=False, steps=8, tolerance=1e-3) if keys else None
        )
        problem.evaluations += held.evaluations
        begin = start if near is None else near.x
        found.append(minimise(problem, begin, until_s, early=False, steps=15, tolerance=1e-4))
    return min(found, key=lambda iterate: iterate.chi_square)


def _clock_groups(problem: FitProblem) -> list[list[int]]:
    """Channels that share a phase: their numbers, group by group."""
    groups: dict[int, list[int]] = {}
    for index, at in enumerate(problem.nuisance_indices):
        groups.setdefault(at.shift, []).append(index)
    return list(groups.values())


def _subproblem(problem: FitProblem, some: list[int]) -> FitProblem:
    """The problem of some channels; all its keys have to be held."""
    return FitProblem(
        problem.free,
        [problem.channels[i] for i in some],
        [problem.models[i] for i in some],
        [problem.chains[i] for i in some],
        problem.fixed,
        tally=problem.tally,
    )


def _minima_by_phase(
    problem: FitProblem, some: list[int], x: np.ndarray, until_s: float
) -> list[Iterate]:
    """The points of some channels at the phases of a grid, with all keys and the phase held, from
    the best to the worst.

    Args:
        problem: of all channels.
        some: the channels, of one clock.
        x: parameters of these channels to begin with.
        until_s: end of the window after the touch, s.
    """
    part = replace(_subproblem(problem, some), phases_held=True)
    phases, found = part.phase_periods, []
    for number in range(_PHASES if phases else 1):
        start = x.copy()
        for at, period in phases.items():
            start[at] = (number + 0.5) / _PHASES * period
        found.append(minimise(part, start, until_s, early=False, steps=2, tolerance=1e-3))
    problem.evaluations += part.evaluations
    return sorted(found, key=lambda iterate: iterate.chi_square)


def _only_actuator_force(channels: Iterable[Channel]) -> bool:
    return all(c.record.quantity == "actuator_force" for c in channels)


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
