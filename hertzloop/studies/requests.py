"""What a study is asked for, as one object: the command line and the Python interface make it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hertzloop.analysis.cases import Span
from hertzloop.options import option


@dataclass(frozen=True)
class Search:
    """A search for the best settings of laws. `at_most`: largest allowed values by figure."""

    objectives: Sequence[str] = option(
        ("plate_energy_db", "rebound_percent"),
        "Minimise this figure; repeat for a Pareto front.", name="minimise",
    )  # fmt: skip
    span: Span = option("impact", "Evaluate the first impact or the whole run.")
    generations: int = option(25, "Stop after this many generations.", min=1, max=10_000)
    population: int = option(40, "Evaluate this many settings in a generation.", min=4, max=1000)
    phases: int = option(1, "Average over this many touch phases.", min=1, max=100)
    seed: int = 1
    require_stable: bool = option(
        False, "Refuse settings whose linear loop is unstable in flight, however short the run."
    )
    at_most: Mapping[str, float] = field(default_factory=dict)
