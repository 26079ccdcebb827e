"""Search for the sequence of latencies, within a range, that is the worst for a law.

A limit over random draws of jitter is no limit over sequences of latencies. An impact sees few
samples, and only the latencies of their commands matter. So the search begins with simple
sequences: constant latencies, and one change between the ends of the range at each sample. It goes
on from the worst of them by coordinate exchange (Meyer and Nachtsheim 1995, Technometrics 37, 60):
blocks of samples, from wide ones to single samples, take other latencies while that is worse. The
result is a bound from below: no search proves that there is no worse sequence.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

import numpy as np

from hertzloop.results.cases import CaseState
from hertzloop.scene.setup import Setup
from hertzloop.studies.worst.window import LatencyWindow, window_of

MOST_CASES = 2000  # of the search within one range
_CONSTANTS = 9  # constant latencies that are tried
_CHANGES = 64  # samples at which a change between the ends is tried, at most
_STARTS = 3  # simple sequences from which the exchange starts
_FEWEST_BLOCKS = 8  # of the window, in the first round of the exchange

Row = dict[str, Any]
Run = Callable[[list[dict[str, Any]]], list[Row]]
# Additional latency of each sample's command from the start of the run, steps, shape (samples,).
Delays = np.ndarray
Block = tuple[int, int, int]  # first sample, end, and the additional latency that they take


@dataclass(frozen=True)
class Objective:
    """What makes a sequence of latencies worse than another.

    Attributes:
        metrics: Names of the metrics that a result has.
        excess: Returns how bad a row is: infinite for an unstable loop, -inf if unknown.
        missed: Returns whether a row is bad enough for a search of the first such sequence.
    """

    metrics: tuple[str, ...]
    excess: Callable[[Row], float]
    missed: Callable[[Row], bool]

    @classmethod
    def largest(cls, metric: str) -> "Objective":
        """Return the objective under which the largest value of a metric is the worst."""

        def excess(row: Row) -> float:
            if row["state"] == CaseState.UNSTABLE:
                return math.inf
            value = row[metric]
            return -math.inf if value is None or math.isnan(value) else float(value)

        return cls((metric,), excess, lambda row: False)


@dataclass(frozen=True)
class WorstSequence:
    """The worst sequence that was found.

    Attributes:
        range_us: Largest additional latency, us.
        latencies_us: Latency of each sample's command from the start of the run, us, as in
            `controller.latency_trace`.
        touch_phase: `run.touch_phase` of the case.
        missed: Whether the objective calls it missed.
        excess: How bad it is by the objective; infinite for a loop that is unstable.
        metrics: Value of each metric of the objective; None without one.
        cases: Number of cases that were simulated for this range.
    """

    range_us: float
    latencies_us: tuple[float, ...]
    touch_phase: float
    missed: bool
    excess: float
    metrics: dict[str, float | None]
    cases: int


@dataclass(frozen=True)
class _Rated:
    """How bad a sequence is: what a `WorstSequence` says of it."""

    missed: bool
    excess: float
    metrics: dict[str, float | None]

    def is_worse(self, other: "_Rated | None") -> bool:
        return other is None or (self.missed, self.excess) > (other.missed, other.excess)


class WorstSearch:
    """Search a scene, within one range of latencies or several; no case is simulated twice.

    Args:
        setup: The scene. Its jitter does not count, and it has no latency trace.
        objective: What makes a sequence worse than another.
        phases: Touch phases at which simple sequences are tried.
        run: Returns the rows of cases, in their order.

    Attributes:
        nominal: Row of the case without additional latency, at the first phase.
        cases: Number of simulated cases.
    """

    def __init__(
        self, setup: Setup, objective: Objective, phases: Sequence[float], run: Run
    ) -> None:
        self.setup, self.objective, self.phases, self.run = setup, objective, phases, run
        self.cases = 0
        self._known: dict[bytes, _Rated] = {}
        (self.nominal,) = run([case_of([setup.scene.controller.latency_us], phases[0])])
        window = window_of(setup, 0, self.nominal)
        self._add(phases[0], np.zeros(window.end, np.int32), self.nominal)

    def within(
        self, most_steps: int, to_first_miss: bool = False, also: Iterable[Delays] = ()
    ) -> WorstSequence:
        """Search for the worst sequence of additional latencies between 0 and a largest one.

        Args:
            most_steps: Largest additional latency, steps.
            to_first_miss: Stop at the first sequence that the objective calls missed.
            also: Sequences within the range that are tried first, at the first phase.
        """
        search = _RangeSearch(self, most_steps, to_first_miss)
        search.go(also)
        assert search.worst is not None
        rated, phase, delays = search.worst
        return WorstSequence(
            range_us=most_steps * self.setup.step_ns / 1000.0,
            latencies_us=tuple(self.latencies_us(delays)),
            touch_phase=phase,
            missed=rated.missed,
            excess=rated.excess,
            metrics=rated.metrics,
            cases=search.cases,
        )

    def latencies_us(self, delays: Delays) -> list[float]:
        """Return the latencies of all samples, us."""
        least_us, step_us = self.setup.scene.controller.latency_us, self.setup.step_ns / 1000.0
        values = {int(delay): least_us + step_us * int(delay) for delay in np.unique(delays)}
        return [values[delay] for delay in delays.tolist()]

    def rate(self, phase: float, tried: Iterable[Delays], most_new: int) -> list[_Rated | None]:
        """Return how bad sequences are at a touch phase; None of those that are not simulated,
        since there are `most_new` others before them."""
        names: list[bytes] = []
        new: dict[bytes, Delays] = {}
        for delays in tried:
            names.append(_name(phase, delays))
            if names[-1] not in self._known and len(new) < most_new:
                new[names[-1]] = delays
        rows = self.run([case_of(self.latencies_us(delays), phase) for delays in new.values()])
        for delays, row in zip(new.values(), rows, strict=True):
            self._add(phase, delays, row)
        return [self._known.get(name) for name in names]

    def _add(self, phase: float, delays: Delays, row: Row) -> None:
        metrics = {name: row[name] for name in self.objective.metrics}
        rated = _Rated(self.objective.missed(row), self.objective.excess(row), metrics)
        self._known[_name(phase, delays)] = rated
        self.cases += 1


class _RangeSearch:
    """The search within one range: `worst` sequence so far, with its rating and touch phase."""

    def __init__(self, search: WorstSearch, most_steps: int, to_first_miss: bool) -> None:
        self.search, self.most, self.to_first_miss = search, most_steps, to_first_miss
        self.window = window_of(search.setup, most_steps, search.nominal)
        # The case without additional latency belongs to the first range.
        self.cases_before = 0 if search.cases == 1 else search.cases
        self.worst: tuple[_Rated, float, Delays] | None = None

    @property
    def cases(self) -> int:
        """Number of cases that were simulated for this range."""
        return self.search.cases - self.cases_before

    @property
    def done(self) -> bool:
        """Whether no case is left, or no worse sequence is wanted or possible."""
        if self.worst is None:
            return False
        rated = self.worst[0]
        enough = (rated.missed and self.to_first_miss) or rated.excess == math.inf
        return enough or self.cases >= MOST_CASES

    def go(self, also: Iterable[Delays]) -> None:
        """Try simple sequences, then exchange blocks of the worst of them."""
        window, phases = self.window, self.search.phases
        self.rate(phases[0], [np.resize(delays, window.end) for delays in also])
        simple = list(_simple_sequences(window, self.most))
        starts: list[tuple[float, float, Delays]] = []
        for phase in phases:
            if self.done:
                break
            found = self.rate(phase, simple)
            starts += [(excess, phase, one) for excess, one in zip(found, simple, strict=True)]
        starts.sort(key=lambda start: -start[0])
        for excess, phase, delays in starts[:_STARTS]:
            self._exchange(phase, delays, excess)

    def rate(self, phase: float, tried: Iterable[Delays]) -> list[float]:
        """Return the excess of sequences; -inf of those for which no case is left. `tried` is
        iterated twice."""
        found = self.search.rate(phase, tried, MOST_CASES - self.cases)
        for rated, delays in zip(found, tried, strict=True):
            if rated is not None and rated.is_worse(self.worst and self.worst[0]):
                self.worst = rated, phase, delays
        return [-math.inf if rated is None else rated.excess for rated in found]

    def _exchange(self, phase: float, delays: Delays, excess: float) -> None:
        """Exchange blocks for the ends and the middle of the range while that is worse."""
        count, values = _FEWEST_BLOCKS, sorted({0, self.most // 2, self.most})
        while not self.done:
            one_block = _Changes(
                delays, [(*block, value) for block in self.window.blocks(count) for value in values]
            )
            found = self.rate(phase, one_block)
            better = [int(i) for i in np.argsort(found)[::-1] if found[i] > excess]
            if better:
                blocks = [one_block.blocks[i] for i in better[:_CHANGES]]
                several = _Changes(delays, blocks, together=True)
                after = self.rate(phase, several)
                candidates = zip(after, several, strict=True)
                excess, delays = max(candidates, key=lambda one: one[0])
            elif count >= 2 * self.window.count:  # all blocks in contact are single samples
                return
            else:
                count *= 2


@dataclass(frozen=True)
class _Changes:
    """Sequences made when needed, as each may be long: each with another block changed, or, if
    `together`, with the first one, two, three, ... blocks changed."""

    delays: Delays
    blocks: list[Block]
    together: bool = False

    def __iter__(self) -> Iterator[Delays]:
        changed = self.delays.copy()
        for first, end, value in self.blocks:
            if not self.together:
                changed = self.delays.copy()
            # Where the value is not new, an earlier change stays.
            is_new = self.delays[first:end] != value
            changed[first:end][is_new] = value
            yield changed.copy()


def case_of(latencies_us: Sequence[float], touch_phase: float) -> dict[str, Any]:
    """Return the settings under which a run has these latencies by sample."""
    return {
        "controller.latency_us": 0.0,
        "controller.jitter_us": 0.0,
        "controller.latency_trace": list(latencies_us),
        "run.touch_phase": touch_phase,
    }


def _name(phase: float, delays: Delays) -> bytes:
    """Return a digest of a sequence at a touch phase, which takes less memory than itself."""
    return blake2b(np.float64(phase).tobytes() + delays.tobytes(), digest_size=16).digest()


def _simple_sequences(window: LatencyWindow, most: int) -> Iterator[Delays]:
    """Yield constant sequences, and those that change once between the ends of the range."""
    sample = np.arange(window.end)
    for value in np.linspace(0, most, min(_CONSTANTS, most + 1)).round():
        yield np.full(window.end, value, np.int32)
    for at, _ in window.blocks(_CHANGES)[1:]:
        yield np.where(sample < at, 0, most).astype(np.int32)
        yield np.where(sample < at, most, 0).astype(np.int32)
