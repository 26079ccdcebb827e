"""What `hertzloop sweep` and `hertzloop.sweep` ask for."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, SkipValidation

from hertzloop.loop.run_options import Options, WorkersOption
from hertzloop.results.spans import SpanOption
from hertzloop.studies.cases.axis import Range
from hertzloop.studies.cases.design import DesignKind


class SweepRequest(Options):
    """Which cases of a scene to run, and where.

    In Python `over` may also map scene keys to lists of values, or to ranges "low:high:step".
    """

    over: Annotated[
        SkipValidation[Mapping[str, Range] | Sequence[str]],
        Field(
            description="Vary a scene key: key=low:high:step, key=a,b,c, or key=low:high for "
            "spread points; repeatable."
        ),
    ] = ()
    design: Annotated[
        DesignKind,
        Field(description="Run all combinations, or points spread over the ranges (lhs, sobol)."),
    ] = "grid"
    cases: Annotated[
        int | None, Field(ge=1, description="Run this many spread points; default: 256.")
    ] = None
    span: SpanOption = "impact"
    workers: WorkersOption = None
    phases: Annotated[
        int | None,
        Field(
            ge=2,
            le=1000,
            description="Run every case at this many touch phases; print mean and range.",
        ),
    ] = None
    uncertain: Annotated[
        Path | None,
        Field(
            description="Run every case with --cases draws from the distributions in this TOML "
            "file, or in the tables [uncertain] and [fit] of this scene."
        ),
    ] = None
    dask: Annotated[
        str | None,
        Field(description="Use the Dask scheduler at this address, for example tcp://host:8786."),
    ] = None

    @property
    def points(self) -> int:
        """Number of spread points, or of draws."""
        return 256 if self.cases is None else self.cases
