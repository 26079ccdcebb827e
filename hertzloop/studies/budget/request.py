"""What `hertzloop budget` and `hertzloop.budget` ask for."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from hertzloop.loop.run_options import Options, Use, WorkersOption
from hertzloop.results.spans import Span

_UNCERTAIN = "Probability of the goal"  # heading of options


class BudgetRequest(Options):
    """What to search for the budget of a law, and how finely."""

    goals: Annotated[
        Sequence[str],
        Field(
            description="Require this at every touch phase, for example 'plate_energy_db <= -3'; "
            "repeatable; default: plate_energy_db <= -0.1."
        ),
        Use(flag="--goal"),
    ] = ()
    quick: Annotated[
        bool, Field(description="Search coarsely, with a thin plate as the real one.")
    ] = False
    only: Annotated[
        Sequence[str],
        Field(description="Search this quantity, for example latency_us; repeatable."),
    ] = ()
    with_real: Annotated[
        bool,
        Field(description="Search in the real plant too."),
        Use(flag="--real-plant/--no-real-plant"),
    ] = True
    span: Annotated[
        Literal["impact", "run", "both"],
        Field(description="Take metrics of the first impact, or of the whole run, or of each."),
    ] = "impact"
    workers: WorkersOption = None
    uncertain: Annotated[
        Path | None,
        Field(
            description="Compute the probability of the goal for the distributions in this TOML "
            "file, or in the tables [uncertain] and [fit] of this scene."
        ),
        Use(heading=_UNCERTAIN),
    ] = None
    within: Annotated[
        float,
        Field(ge=1e-4, le=0.5, description="Stop drawing at this half width of the interval."),
        Use(heading=_UNCERTAIN),
    ] = 0.03
    most_cases: Annotated[
        int,
        Field(ge=16, le=1_000_000, description="Stop drawing after this many cases."),
        Use(heading=_UNCERTAIN),
    ] = 4096

    @property
    def first_span(self) -> Span:
        """The span whose metrics come first."""
        return "impact" if self.span == "both" else self.span
