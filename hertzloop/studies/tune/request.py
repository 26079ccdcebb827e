"""What `hertzloop tune` and `hertzloop.tune` ask for."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated

from pydantic import Field, SkipValidation, field_validator

from hertzloop.loop.run_options import Options, Use, WorkersOption
from hertzloop.results.spans import SpanOption
from hertzloop.studies.cases.axis import Range


class TuneRequest(Options):
    """A search for the best settings of laws.

    In Python `vary` and `over` may also map scene keys to ranges, and `at_most` metrics to numbers.
    """

    laws: Annotated[
        Sequence[str],
        Field(description="Tune this law, or all; repeatable; default: the law of the scene."),
        Use(flag="--law"),
    ] = ()
    vary: Annotated[
        SkipValidation[Mapping[str, Range] | Sequence[str]],
        Field(
            description="Search a scene key over key=low:high or key=a,b,c; default: the ranges of "
            "the law."
        ),
    ] = ()
    over: Annotated[
        SkipValidation[Mapping[str, Range] | Sequence[str]],
        Field(
            description="Require robustness over these values, for example "
            "sphere.radius_m=0.002,0.004."
        ),
    ] = ()
    minimise: Annotated[
        Sequence[str], Field(description="Minimise this metric; repeat for a Pareto front.")
    ] = ("plate_energy_db", "rebound_percent")
    at_most: Annotated[
        Mapping[str, float],
        Field(description="Limit a metric, for example rebound_percent=120."),
    ] = {}
    span: SpanOption = "impact"
    generations: Annotated[
        int, Field(ge=1, le=10_000, description="Stop after this many generations.")
    ] = 25
    population: Annotated[
        int, Field(ge=4, le=1000, description="Evaluate this many settings in a generation.")
    ] = 40
    phases: Annotated[
        int, Field(ge=1, le=100, description="Average over this many touch phases.")
    ] = 1
    seed: Annotated[int, Field(description="Set the random seed of the search.")] = 1
    require_stable: Annotated[
        bool,
        Field(
            description="Refuse settings whose linear loop is unstable in flight, however short "
            "the run."
        ),
    ] = False
    workers: WorkersOption = None

    @field_validator("at_most", mode="before")
    @classmethod
    def _limits(cls, given: object) -> object:
        """Read limits that are texts, as on the command line."""
        if not isinstance(given, list | tuple):
            return given
        limits = {}
        for text in given:
            match = re.fullmatch(r"\s*(\w+)\s*=\s*(\S+)\s*", text)
            with suppress(ValueError):
                if match and math.isfinite(float(match[2])):
                    limits[match[1]] = float(match[2])
                    continue
            raise ValueError(
                f"--at-most = '{text}': invalid limit. Write metric=number, as in "
                "rebound_percent=120."
            )
        return limits
