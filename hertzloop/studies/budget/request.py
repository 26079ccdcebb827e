"""What `hertzloop budget` and `hertzloop.budget` ask for."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hertzloop.loop.run_options import check_list
from hertzloop.results.spans import Span


@dataclass(frozen=True)
class BudgetRequest:
    """What to search for the budget of a law, and how finely.

    Attributes:
        goals: Conditions as text that the law must meet at every touch phase, for example
            "plate_energy_db <= -3"; none: plate_energy_db <= -0.1.
        quick: Whether the search is coarse, with a thin plate as the real one.
        only: Quantities to search; all if empty.
        with_real: Whether the real plant is searched too.
        span: Part of the run that is evaluated, or both.
        workers: Number of processes; None: one for each core.
        uncertain: File or scene with distributions, for the probability that the goals are met.
        within: Half the width at which the interval of the probability is narrow enough.
        most_cases: Largest number of cases drawn for the probability.
    """

    goals: Sequence[str] = ()
    quick: bool = False
    only: Sequence[str] = ()
    with_real: bool = True
    span: Literal["impact", "run", "both"] = "impact"
    workers: int | None = None
    uncertain: Path | None = None
    within: float = 0.03
    most_cases: int = 4096

    @property
    def first_span(self) -> Span:
        """The span whose metrics come first."""
        return "impact" if self.span == "both" else self.span

    def __post_init__(self) -> None:
        """Raise OptionError for text in place of a list."""
        check_list("goals", self.goals)
        check_list("only", self.only)
