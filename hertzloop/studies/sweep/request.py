"""What `hertzloop sweep` and `hertzloop.sweep` ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hertzloop.loop.run_options import check_list
from hertzloop.results.spans import Span
from hertzloop.studies.cases.axis import Range
from hertzloop.studies.cases.design import DesignKind


@dataclass(frozen=True)
class SweepRequest:
    """Which cases of a scene to run, and where.

    Attributes:
        over: Ranges by scene key: a list of values, "low:high:step", or "low:high" for spread
            points; or texts such as "sensors.bits=8,12".
        design: "grid" for all combinations of the ranges; "lhs" or "sobol" for points spread over
            them.
        cases: Number of spread points, or of draws; None: 256.
        span: Part of a run that is evaluated: the first impact or the whole run.
        workers: Number of processes; None: one for each core.
        phases: Number of touch phases of every case; None: that of the scene alone.
        uncertain: File or scene with distributions that every case draws from.
        dask: Address of a Dask scheduler that runs the cases.
    """

    over: Mapping[str, Range] | Sequence[str] = ()
    design: DesignKind = "grid"
    cases: int | None = None
    span: Span = "impact"
    workers: int | None = None
    phases: int | None = None
    uncertain: Path | None = None
    dask: str | None = None

    def __post_init__(self) -> None:
        """Raise OptionError for text in place of a list."""
        check_list("over", self.over)

    @property
    def points(self) -> int:
        """Number of spread points, or of draws."""
        return 256 if self.cases is None else self.cases
