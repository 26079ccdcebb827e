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
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np

from hertzloop.results.cases import CaseState
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.rows import Case, Row, Rows, RunCases, check_none_failed
from hertzloop.studies.worst.window import LatencyWindow, window_of

MOST_CASES = 2000  # of the search within one range
_CONSTANTS = 9  # constant latencies that are tried
_CHANGES = 64  # samples at which a change between the ends is tried, at most
_STARTS = 3  # simple sequences from which the exchange starts
_FEWEST_BLOCKS = 8  # of the window, in the first round of the exchange

# Additional latency of each sample's command from the start of the run, steps, shape (samples,).
Delays = np.ndarray


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
    missed: Callable[[Row], bool] = lambda row: False


def largest(metric: str) -> Objective:
    """Return the objective under which the largest value of a metric is the worst."""

    def excess(row: Row) -> float:
        if row["state"] == CaseState.UNSTABLE:
            return math.inf
        value = row[metric]
        return -math.inf if value is None or math.isnan(value) else float(value)

    return Objective((metric,), excess)


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
        cases: Number of cases that were simulated for this range, with the nominal one.
    """

    range_us: float
    latencies_us: tuple[float, ...]
    touch_phase: float
    missed: bool
    excess: float
    metrics: dict[str, float | None]
    cases: int


@dataclass(frozen=True, order=True)
class _Rated:
    """How bad a sequence is at a touch phase: what a `WorstSequence` says of it."""

    missed: bool
    excess: float
    metrics: dict[str, float | None] = field(compare=False)


class WorstSearch:
    """Search a scene, within one range of latencies after another; no case is simulated twice.

    Args:
        setup: The scene. Its jitter does not count, and it has no latency trace.
        objective: What makes a sequence worse than another.
        phases: Touch phases at which simple sequences are tried.
        run: Returns the rows of cases, in their order.

    Raises:
        CaseFailed: a case failed in its run, here or in `within`.

    Attributes:
        nominal: Row of the case without additional latency, at the first phase.
        cases: Number of simulated cases.
    """

    def __init__(
        self, setup: Setup, objective: Objective, phases: Sequence[float], run: RunCases
    ) -> None:
        self.setup, self.objective, self.phases, self.run = setup, objective, phases, run
        (self.nominal,) = self._run([case_of([setup.scene.controller.latency_us], phases[0])])
        self.cases = 1
        without = np.zeros(window_of(setup, 0, self.nominal).end, np.int32)
        self._nominal = self._rated(self.nominal), phases[0], without
        self._known = {_name(phases[0], without): self._nominal[0]}

    def within(
        self, most_steps: int, to_first_miss: bool = False, also: Iterable[Delays] = ()
    ) -> WorstSequence:
        """Search for the worst sequence of additional latencies between 0 and a largest one.

        Args:
            most_steps: Largest additional latency, steps.
            to_first_miss: Stop at the first sequence that the objective calls missed.
            also: Sequences within the range that are tried first, at the first phase.
        """
        self._worst, self._last = self._nominal, self.cases + MOST_CASES - 1
        self._to_first_miss, before = to_first_miss, self.cases - 1
        window = window_of(self.setup, most_steps, self.nominal)
        self._rate(self.phases[0], [np.resize(delays, window.end) for delays in also])
        simple = list(_simple_sequences(window, most_steps))
        starts: list[tuple[float, float, Delays]] = []
        for phase in self.phases:
            if not self._done:
                found = self._rate(phase, simple)
                starts += [(excess, phase, one) for excess, one in zip(found, simple, strict=True)]
        starts.sort(key=lambda start: -start[0])
        for excess, phase, delays in starts[:_STARTS]:
            self._exchange(window, most_steps, phase, delays, excess)
        rated, phase, delays = self._worst
        return WorstSequence(
            range_us=most_steps * self.setup.step_ns / 1000.0,
            latencies_us=tuple(self._latencies_us(delays)),
            touch_phase=phase,
            **vars(rated),
            cases=self.cases - before,
        )

    @property
    def _done(self) -> bool:
        """Whether no case is left, or no worse sequence is wanted or possible."""
        rated = self._worst[0]
        enough = (rated.missed and self._to_first_miss) or rated.excess == math.inf
        return enough or self.cases >= self._last

    def _rate(self, phase: float, tried: Sequence[Delays]) -> list[float]:
        """Return the excess of sequences; -inf of those for which no case is left."""
        names = [_name(phase, delays) for delays in tried]
        new = {n: one for n, one in zip(names, tried, strict=True) if n not in self._known}
        new = dict(list(new.items())[: self._last - self.cases])
        rows = self._run([case_of(self._latencies_us(delays), phase) for delays in new.values()])
        self._known |= {n: self._rated(row) for n, row in zip(new, rows, strict=True)}
        self.cases += len(new)
        found = [self._known.get(name) for name in names]
        for rated, delays in zip(found, tried, strict=True):
            if rated and rated > self._worst[0]:
                self._worst = rated, phase, delays
        return [rated.excess if rated else -math.inf for rated in found]

    def _run(self, cases: list[Case]) -> Rows:
        rows = self.run(cases)
        check_none_failed(rows)  # a failure is no bad value: the worst sequence is unknown
        return rows

    def _rated(self, row: Row) -> _Rated:
        metrics = {name: row[name] for name in self.objective.metrics}
        return _Rated(self.objective.missed(row), self.objective.excess(row), metrics)

    def _latencies_us(self, delays: Delays) -> list[float]:
        """Return the latencies of all samples, us."""
        least_us, step_us = self.setup.scene.controller.latency_us, self.setup.step_ns / 1000.0
        values = [least_us + step_us * delay for delay in range(delays.max() + 1)]
        return [values[delay] for delay in delays]

    def _exchange(
        self, window: LatencyWindow, most: int, phase: float, delays: Delays, excess: float
    ) -> None:
        """Exchange blocks of samples for the ends and the middle of the range while that is
        worse."""
        count, values = _FEWEST_BLOCKS, sorted({0, most // 2, most})
        while not self._done:
            blocks = [(*block, value) for block in window.blocks(count) for value in values]
            new = [block for block in blocks if (delays[block[0] : block[1]] != block[2]).any()]
            tried = [_changed(delays, *block) for block in new[: self._last - self.cases]]
            found = self._rate(phase, tried)
            better = [tried[i] for i in np.argsort(found)[::-1] if found[i] > excess]
            if better:
                merged = _merged(delays, better[:_CHANGES])
                candidates = zip(self._rate(phase, merged), merged, strict=True)
                excess, delays = max(candidates, key=lambda one: one[0])
            elif count >= 2 * window.count:  # all blocks in contact are single samples
                return
            else:
                count *= 2


def case_of(latencies_us: Sequence[float], touch_phase: float) -> Case:
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
    for value in np.linspace(0, most, min(_CONSTANTS, most + 1)).round():
        yield np.full(window.end, value, np.int32)
    for at, _ in window.blocks(_CHANGES)[1:]:
        for before, after in ((0, most), (most, 0)):
            yield _changed(np.full(window.end, before, np.int32), at, window.end, after)


def _changed(delays: Delays, first: int, end: int, value: int) -> Delays:
    """Return a copy of a sequence with another value in a block of samples."""
    changed = delays.copy()
    changed[first:end] = value
    return changed


def _merged(delays: Delays, better: Sequence[Delays]) -> list[Delays]:
    """Return the sequences with the first one, two, three, ... of several changes together."""
    merged = [delays]
    for one in better:
        merged.append(np.where(one != delays, one, merged[-1]))
    return merged[1:]
