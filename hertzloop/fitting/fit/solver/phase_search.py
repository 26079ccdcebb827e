"""Minimise over the sampling phases of records under a law."""

from dataclasses import replace

import numpy as np

from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.solver.minimise import minimise

_PHASES = 6  # of a period that a search looks at
_TURNS_TRIED = 3  # solutions at other phases that are fitted with all parameters
_APART = 0.25  # of a period, between them


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
