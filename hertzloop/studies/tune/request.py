"""What `hertzloop tune` and `hertzloop.tune` ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hertzloop.loop.run_options import check_list
from hertzloop.results.spans import Span
from hertzloop.studies.cases.axis import Range


@dataclass(frozen=True)
class TuneRequest:
    """A search for the best settings of laws.

    Attributes:
        laws: Names or files of the laws; none: the law of the first scene; "all" alone: all laws
            of `LAWS`.
        vary: Ranges to search, by scene key or as texts such as "controller.kappa=0:1"; none: the
            usual ranges of each law.
        over: Values that the settings have to be robust over, by scene key or as texts.
        minimise: Metrics to minimise; several give a Pareto front.
        at_most: Largest allowed values, by metric.
        span: Part of the run that is evaluated: the first impact or the whole run.
        generations: Number of generations of the search.
        population: Number of settings in a generation.
        phases: Number of touch phases to average over.
        seed: Random seed of the search.
        require_stable: Whether settings whose linear loop is unstable in flight are refused.
        workers: Number of processes; None: one for each core.
    """

    laws: Sequence[str] = ()
    vary: Mapping[str, Range] | Sequence[str] = ()
    over: Mapping[str, Range] | Sequence[str] = ()
    minimise: Sequence[str] = ("plate_energy_db", "rebound_percent")
    at_most: Mapping[str, float] = field(default_factory=dict)
    span: Span = "impact"
    generations: int = 25
    population: int = 40
    phases: int = 1
    seed: int = 1
    require_stable: bool = False
    workers: int | None = None

    def __post_init__(self) -> None:
        """Raise OptionError for text in place of a list."""
        for name in ("laws", "vary", "over", "minimise"):
            check_list(name, getattr(self, name))
