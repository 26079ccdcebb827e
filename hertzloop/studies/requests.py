"""Requests of the studies, which the command line and the Python interface make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hertzloop.results.cases import Span


@dataclass(frozen=True)
class TuneRequest:
    """A search for the best settings of laws.

    Attributes:
        objectives: Metrics to minimise; several give a Pareto front.
        span: Part of the run that is evaluated: the first impact or the whole run.
        generations: Number of generations of the search.
        population: Number of settings in a generation.
        phases: Number of touch phases to average over.
        seed: Random seed of the search.
        require_stable: Whether settings whose linear loop is unstable in flight are refused.
        at_most: Largest allowed values, by metric.
    """

    objectives: Sequence[str] = ("plate_energy_db", "rebound_percent")
    span: Span = "impact"
    generations: int = 25
    population: int = 40
    phases: int = 1
    seed: int = 1
    require_stable: bool = False
    at_most: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepRequest:
    """Which cases of a scene to run, and where.

    Attributes:
        over: Axes as text: key=low:high:step, key=a,b,c, or key=low:high for spread points.
        design: All combinations of the axes, or points spread over their ranges.
        cases: Number of spread points, or of draws; None: 256.
        span: Part of a run that is evaluated: the first impact or the whole run.
        workers: Number of processes; None: one for each core.
        phases: Number of touch phases of every case; None: that of the scene alone.
        uncertain: File or scene with distributions that every case draws from.
        dask: Address of a Dask scheduler that runs the cases.
        worst: Metric whose worst latencies within the jitter are searched in every case; None: no
            search.
    """

    over: Sequence[str] = ()
    design: Literal["grid", "lhs", "sobol"] = "grid"
    cases: int | None = None
    span: Span = "impact"
    workers: int | None = None
    phases: int | None = None
    uncertain: Path | None = None
    dask: str | None = None
    worst: str | None = None

    @property
    def points(self) -> int:
        """Number of spread points, or of draws."""
        return 256 if self.cases is None else self.cases


@dataclass(frozen=True)
class BudgetRequest:
    """What to search for the budget of a law, and how finely.

    Attributes:
        goals: Conditions as text that the law must meet at every touch phase.
        quick: Whether the search is coarse, with a thin plate as the real one.
        only: Quantities to search; all if empty.
        with_real: Whether the real plant is searched too.
        span: Part of the run that is evaluated, or both.
        workers: Number of processes; None: one for each core.
        within: Half the width at which the interval of the probability is narrow enough.
        most_cases: Largest number of cases drawn for the probability.
        sobol: Base points for Sobol indices, a power of 2; 0: none.
        worst: Whether the worst sequence of latencies within the jitter is searched too.
    """

    goals: Sequence[str] = ()
    quick: bool = False
    only: Sequence[str] = ()
    with_real: bool = True
    span: Literal["impact", "run", "both"] = "impact"
    workers: int | None = None
    within: float = 0.03
    most_cases: int = 4096
    sobol: int = 0
    worst: bool = False

    @property
    def first_span(self) -> Span:
        """The span whose metrics come first."""
        return "impact" if self.span == "both" else self.span
