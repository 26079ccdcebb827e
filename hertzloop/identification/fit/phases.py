"""Minimise over the sampling phases of records under a law."""

from dataclasses import replace

import numpy as np

from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.minimise import minimise
from hertzloop.identification.fit.problem import FitProblem

_PHASES = 6  # of a period that a search looks at
_TURNS_TRIED = 3  # solutions at other phases that are fitted with all parameters
_APART = 0.25  # of a period, between them


def minimise_over_phases(problem: FitProblem, x: np.ndarray, until_s: float) -> Iterate:
    """Return the best fit over all phases, from parameters `x`.

    Where the law decides otherwise, a step of the solution cannot go on. So the most promising
    parts of a period are all tried.
    """
    if not problem.phase_periods:
        return minimise(problem, x, until_s, early=False)
    alone = replace(problem, fixed=problem.key_values(x))
    keys = len(problem.varied_keys)
    groups = clock_groups(alone)
    places = [
        sorted({at for i in some for at in problem.nuisance_indices[i].all}) for some in groups
    ]
    ranked = [
        _distinct_phases(
            minima_by_phase(alone, some, x[at], until_s), subproblem(alone, some).phase_periods
        )
        for some, at in zip(groups, places, strict=True)
    ]
    found = []
    for rank in range(max(len(iterates) for iterates in ranked)):
        start = x.copy()
        for iterates, at in zip(ranked, places, strict=True):
            start[at] = iterates[min(rank, len(iterates) - 1)].x
        held = replace(problem, phases_held=True)
        near = (
            minimise(held, start, until_s, early=False, steps=8, tolerance=1e-3) if keys else None
        )
        begin = start if near is None else near.x
        found.append(minimise(problem, begin, until_s, early=False, steps=15, tolerance=1e-4))
    return min(found, key=lambda iterate: iterate.chi_square)


def minima_by_phase(
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
    part = replace(subproblem(problem, some), phases_held=True)
    phases, found = part.phase_periods, []
    for number in range(_PHASES if phases else 1):
        start = x.copy()
        for at, period in phases.items():
            start[at] = (number + 0.5) / _PHASES * period
        found.append(minimise(part, start, until_s, early=False, steps=2, tolerance=1e-3))
    return sorted(found, key=lambda iterate: iterate.chi_square)


def clock_groups(problem: FitProblem) -> list[list[int]]:
    """Channels that share a phase: their numbers, group by group."""
    groups: dict[int, list[int]] = {}
    for index, at in enumerate(problem.nuisance_indices):
        groups.setdefault(at.shift, []).append(index)
    return list(groups.values())


def subproblem(problem: FitProblem, some: list[int]) -> FitProblem:
    """The problem of some channels; all its keys have to be held."""
    return FitProblem(
        problem.free,
        [problem.channels[i] for i in some],
        [problem.models[i] for i in some],
        [problem.chains[i] for i in some],
        problem.fixed,
        counter=problem.counter,
    )


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
