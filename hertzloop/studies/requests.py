"""What a study is asked for, as one object: the command line and the Python interface make it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hertzloop.loop.run_options import option
from hertzloop.results.cases import Span


@dataclass(frozen=True)
class TuneRequest:
    """A search for the best settings of laws. `at_most`: largest allowed values by figure."""

    objectives: Sequence[str] = option(
        ("plate_energy_db", "rebound_percent"),
        "Minimise this figure; repeat for a Pareto front.",
        name="minimise",
    )
    span: Span = option("impact", "Evaluate the first impact or the whole run.")
    generations: int = option(25, "Stop after this many generations.", min=1, max=10_000)
    population: int = option(40, "Evaluate this many settings in a generation.", min=4, max=1000)
    phases: int = option(1, "Average over this many touch phases.", min=1, max=100)
    seed: int = 1
    require_stable: bool = option(
        False, "Refuse settings whose linear loop is unstable in flight, however short the run."
    )
    at_most: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepRequest:
    """Which cases of a scene to run, and where. `phases` adds touch phases, and `dask` an
    address."""

    over: Sequence[str] = option(
        (),
        "Vary a scene key: key=low:high:step, key=a,b,c, or key=low:high for spread points; "
        "repeatable.",
    )
    design: Literal["grid", "lhs", "sobol"] = option(
        "grid", "Run all combinations, or points spread over the ranges."
    )
    cases: int | None = option(
        None, "Run this many spread points; default: 256, with --verify 10.", min=1
    )
    span: Span = option("impact", "Evaluate the first impact or the whole run.")
    workers: int | None = option(
        None, "Use this many processes; default: one for each core.", min=1
    )
    phases: int | None = option(
        None, "Run every case at this many touch phases; print mean and range.", min=2, max=1000
    )
    uncertain: Path | None = option(
        None,
        "Run every case with --cases draws from the distributions in this TOML file, or "
        "in the tables [uncertain] and [fit] of this scene.",
    )
    dask: str | None = option(
        None, "Use the Dask scheduler at this address, for example tcp://host:8786."
    )

    @property
    def points(self) -> int:
        """How many spread points, or draws."""
        return 256 if self.cases is None else self.cases


@dataclass(frozen=True)
class BudgetRequest:
    """What to search for the budget of a law, and how finely."""

    goals: Sequence[str] = option(
        (),
        "Condition that the law must meet at every touch phase, e.g. 'plate_energy_db <= -3'. "
        "May be given several times. Default: plate_energy_db <= -0.1.",
        name="goal",
    )
    quick: bool = option(False, "Search coarsely, with a thin plate as the real one.")
    only: Sequence[str] = option(
        (), "Quantity to search, e.g. latency_us. May be given several times."
    )
    with_real: bool = option(True, "Search in the real plant too.", name="real-plant")
    span: Literal["impact", "run", "both"] = option(
        "impact", "Take figures of the first impact, or of the whole run, or of each."
    )
    workers: int | None = option(None, "Number of processes; all cores if not given.", min=1)
    within: float = option(
        0.03, "Half the width at which the interval is narrow enough.", min=1e-4, max=0.5
    )
    most_cases: int = option(4096, "Stop drawing after this many cases.", min=16, max=1_000_000)
    sobol: int = option(0, "Base points for Sobol indices, a power of 2; 0 for none.", min=0)

    @property
    def first_span(self) -> Span:
        """The span whose figures come first."""
        return "impact" if self.span == "both" else self.span
