"""A constant force from the first sample in contact on."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from hertzloop.controller.law import Force, ForceBound, LawContext, StepsUs
from hertzloop.controller.laws import profile
from hertzloop.controller.laws.profile import (  # noqa: F401
    State,
    command,
    command_ahead,
    known_ahead,
    trigger_level,
)

open_loop = True


class Parameters(profile.Timing):
    """Scene keys."""

    force_n: Force = Field(0.0, description="the force")
    duration_us: StepsUs = Field(0.0, description="its length")

    @model_validator(mode="after")
    def _lasts(self) -> Self:
        if self.duration_us == 0.0:
            raise ValueError(
                "controller.duration_us = 0; law 'constant' needs the length of its force"
            )
        return self


def prepare(keys, about: LawContext) -> profile.Constants:
    """Constants of a profile of one value."""
    return profile.played(np.full(about.samples(keys.duration_us), keys.force_n), keys, about)


def force_bound(keys) -> ForceBound:
    """The force itself."""
    return ForceBound(force_n=abs(keys.force_n))
