"""Search for the sequence of latencies, within a range, that makes a law miss its goal the most.

A limit over random draws of jitter is no limit over sequences of latencies. An impact sees few
samples, and only the latencies of their commands matter. So the search begins with simple
sequences: constant latencies, and one change between the ends of the range at each sample. It goes
on from the worst of them by coordinate exchange (Meyer and Nachtsheim 1995, Technometrics 37, 60):
blocks of samples, from wide ones to single samples, take other latencies while that is worse. The
result is a bound from below: no search proves that there is no worse sequence.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import Goal, all_met, worst_excess
from hertzloop.studies.cases.evaluate import Rows
from hertzloop.studies.cases.touch_phases import Spread, spread_of

MOST_CASES = 2000  # of one search
_CONSTANTS = 9  # constant latencies that are tried
_CHANGES = 64  # samples at which a change between the ends is tried, at most
_DRAWS = 200  # of random jitter, beside the worst sequence
_STARTS = 3  # simple sequences from which the exchange starts
_FEWEST_BLOCKS = 8  # of the window, in the first round of the exchange

Run = Callable[[list[dict[str, Any]]], Rows]
Delays = tuple[int, ...]  # additional latency of each sample's command, steps


@dataclass(frozen=True)
class WorstSequence:
    """The worst sequence that was found.

    Attributes:
        range_us: Largest additional latency, us.
        latencies_us: Latency of each sample's command from the start of the run, us, as in
            `controller.latency_trace`.
        touch_phase: `run.touch_phase` of the case.
        missed: Whether it misses a goal.
        excess: By how much the goals are missed, relative to their limits; infinite for a loop that
            is unstable, negative if all goals are met.
        metrics: Value of each goal's metric; None without one.
        cases: Number of cases that the search simulated.
    """

    range_us: float
    latencies_us: tuple[float, ...]
    touch_phase: float
    missed: bool
    excess: float
    metrics: dict[str, float | None]
    cases: int


@dataclass(frozen=True)
class WorstLimit:
    """Up to which range of additional latency no sequence that misses a goal was found.

    Attributes:
        tolerated_us: The range, us; None if a goal is missed without additional latency.
        worst: Worst sequence within the next range, which misses a goal; None if there is none up
            to the largest range.
        draws: Metrics of the goals over random draws of jitter within that range.
        searched_us: Largest range that was searched, us.
        cases: Number of cases.
    """

    tolerated_us: float | None
    worst: WorstSequence | None
    draws: dict[str, Spread]
    searched_us: float
    cases: int


@dataclass(frozen=True)
class LatencyWindow:
    """Samples whose latencies matter to the first impact: from `first` until `end`. Until `fine`
    there is contact, where single samples matter; later ones matter less and less."""

    first: int
    fine: int
    end: int

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.end - self.first

    def blocks(self, count: int) -> list[tuple[int, int]]:
        """Return about `count` blocks, as first sample and end from the start of the window: of
        equal length in contact, and longer the later they are after it."""
        fine = self.fine - self.first
        after = np.arange(self.count - fine)
        weight = np.concatenate([np.ones(fine), fine / (fine + after)])
        reached = np.concatenate([[0.0], np.cumsum(weight)])
        edges = np.unique(np.searchsorted(reached, np.linspace(0.0, reached[-1], count + 1)))
        return [(int(a), int(b)) for a, b in pairwise(edges)]


class _Search:
    """Cases tried, and the worst of them."""

    def __init__(
        self,
        setup: Setup,
        goals: Sequence[Goal],
        run: Run,
        window: LatencyWindow,
        to_first_miss: bool,
    ) -> None:
        self.goals, self.run, self.window, self.to_first_miss = goals, run, window, to_first_miss
        self.step_us = setup.step_ns / 1000.0
        self.latency_us = setup.scene.controller.latency_us
        self.cases = 0
        self.known: dict[tuple[float, Delays], float] = {}
        self.worst: tuple[tuple[bool, float], float, Delays, dict[str, Any]] | None = None

    def latencies_us(self, delays: Delays) -> list[float]:
        """Return the latencies of all samples, us."""
        before = [self.latency_us] * self.window.first
        return before + [self.latency_us + self.step_us * delay for delay in delays]

    def try_all(self, phase: float, tried: Sequence[Delays]) -> list[float]:
        """Return the excess of sequences at a touch phase; no more are simulated than allowed."""
        new = [one for one in dict.fromkeys(tried) if (phase, one) not in self.known]
        new = new[: MOST_CASES - self.cases]
        rows = self.run([case_of(self.latencies_us(one), phase) for one in new])
        self.cases += len(new)
        for one, row in zip(new, rows, strict=True):
            excess = worst_excess(self.goals, row)
            self.known[phase, one] = excess
            rank = not all_met(self.goals, row), excess
            if self.worst is None or rank > self.worst[0]:
                self.worst = rank, phase, one, row
        return [self.known.get((phase, one), -np.inf) for one in tried]

    @property
    def done(self) -> bool:
        """Whether no case is left, or no worse sequence is wanted or possible."""
        if self.worst is None:
            return False
        missed, excess = self.worst[0]
        return (missed and self.to_first_miss) or excess == np.inf or self.cases >= MOST_CASES


def case_of(latencies_us: Sequence[float], touch_phase: float) -> dict[str, Any]:
    """Return the settings under which a run has these latencies by sample."""
    return {
        "controller.latency_us": 0.0,
        "controller.jitter_us": 0.0,
        "controller.latency_trace": list(latencies_us),
        "run.touch_phase": touch_phase,
    }


def window_of(setup: Setup, most_steps: int, nominal: dict[str, Any]) -> LatencyWindow:
    """Return the samples whose latencies matter to the first impact.

    Args:
        setup: The scene.
        most_steps: Largest additional latency, steps: a command before the touch may be that late.
        nominal: The row of the case without additional latency.
    """
    every = setup.scene.sensors.every_steps
    touch = round(setup.first_touch_s / setup.step_s)
    latency = round(setup.scene.controller.latency_us * 1000 / setup.step_ns)
    contact = round((nominal["contact_us"] or 0.0) * 1000 / setup.step_ns)
    first = max(0, touch - latency - most_steps - 1) // every
    fine = max(first + 1, -(-(touch + contact) // every))
    return LatencyWindow(first, fine, max(fine, -(-(nominal["steps"] or setup.steps) // every)))


def worst_sequence(
    setup: Setup,
    goals: Sequence[Goal],
    most_steps: int,
    phases: Sequence[float],
    run: Run,
    to_first_miss: bool = False,
) -> WorstSequence:
    """Search for the worst sequence of additional latencies between 0 and a largest one.

    Args:
        setup: The scene, without jitter and latency trace.
        goals: What the law has to do.
        most_steps: Largest additional latency, steps.
        phases: Touch phases at which simple sequences are tried.
        run: Returns the rows of cases, in their order.
        to_first_miss: Stop at the first sequence that misses a goal.
    """
    (nominal,) = run([case_of([setup.scene.controller.latency_us], phases[0])])
    window = window_of(setup, most_steps, nominal)
    search = _Search(setup, goals, run, window, to_first_miss)
    simple = list(dict.fromkeys(_simple_sequences(window, most_steps)))
    starts: list[tuple[float, float, Delays]] = []
    for phase in phases:
        if search.done:
            break
        found = search.try_all(phase, simple)
        starts += [(excess, phase, one) for excess, one in zip(found, simple, strict=True)]
    starts.sort(key=lambda start: -start[0])
    for excess, phase, delays in starts[:_STARTS]:
        _exchange(search, phase, delays, excess, most_steps)
    assert search.worst is not None
    (missed, excess), phase, delays, row = search.worst
    return WorstSequence(
        range_us=most_steps * search.step_us,
        latencies_us=tuple(search.latencies_us(delays)),
        touch_phase=phase,
        missed=missed,
        excess=excess,
        metrics={goal.metric: row[goal.metric] for goal in goals},
        cases=search.cases + 1,
    )


def worst_limit(
    setup: Setup, goals: Sequence[Goal], most_steps: int, phases: Sequence[float], run: Run
) -> WorstLimit:
    """Find up to which range of additional latency the goals are met, as far as the search goes.

    A sequence within a range is also within a larger one, so the limit is found by bisection.
    Arguments are those of `worst_sequence`; `most_steps` is the largest range that is searched.
    """
    step_us, cases = setup.step_ns / 1000.0, 0

    def misses(steps: int) -> bool:
        nonlocal cases
        found = worst_sequence(setup, goals, steps, phases, run, to_first_miss=True)
        cases += found.cases
        return found.missed

    if misses(0):
        return WorstLimit(None, None, {}, most_steps * step_us, cases)
    if not misses(most_steps):
        return WorstLimit(most_steps * step_us, None, {}, most_steps * step_us, cases)
    good, bad = 0, most_steps
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (good, middle) if misses(middle) else (middle, bad)
    worst = worst_sequence(setup, goals, bad, phases, run)
    jitter = {"controller.jitter_us": bad * step_us, "run.touch_phase": worst.touch_phase}
    rows = run([jitter | {"run.seed": setup.seed + i} for i in range(_DRAWS)])
    draws = {goal.metric: spread_of([row[goal.metric] for row in rows]) for goal in goals}
    cases += worst.cases + _DRAWS
    return WorstLimit(good * step_us, worst, draws, most_steps * step_us, cases)


def _simple_sequences(window: LatencyWindow, most: int) -> Iterator[Delays]:
    """Yield constant sequences, and those that change once between the ends of the range."""
    count = window.count
    for value in np.linspace(0, most, min(_CONSTANTS, most + 1)).round().astype(int):
        yield (int(value),) * count
    for at, _ in window.blocks(_CHANGES)[1:]:
        yield (0,) * at + (most,) * (count - at)
        yield (most,) * at + (0,) * (count - at)


def _exchange(search: _Search, phase: float, delays: Delays, excess: float, most: int) -> None:
    """Exchange blocks of samples for the ends and the middle of the range while that is worse."""
    window, count, values = search.window, _FEWEST_BLOCKS, sorted({0, most // 2, most})
    while not search.done:
        blocks = window.blocks(count)
        tried = [
            delays[:first] + (value,) * (end - first) + delays[end:]
            for first, end in blocks
            for value in values
        ]
        found = search.try_all(phase, tried)
        better = [int(i) for i in np.argsort(found)[::-1] if found[i] > excess]
        if better:
            merged = _merged(delays, [tried[i] for i in better])
            after = search.try_all(phase, merged)
            candidates = [(found[better[0]], tried[better[0]]), *zip(after, merged, strict=True)]
            excess, delays = max(candidates, key=lambda one: one[0])
        elif count >= 2 * window.count:  # all blocks in contact are single samples
            return
        else:
            count *= 2


def _merged(delays: Delays, better: Sequence[Delays]) -> list[Delays]:
    """Return the sequences with the first two, three, ... of several changes made together."""
    found, merged = [], np.array(delays)
    for number, one in enumerate(better[:_CHANGES]):
        changed = np.array(one) != np.array(delays)
        merged = np.where(changed, one, merged)
        if number:
            found.append(tuple(map(int, merged)))
    return found
