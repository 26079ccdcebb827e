"""Given forces, one a sample, from the first sample in contact on."""

from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from hertzloop.controller import law

open_loop = True


class Timing(law.Keys):
    """Scene keys of all laws that play given forces."""

    delay_us: law.StepsUs = Field(0.0, description="no force for so long at first")
    lead_us: law.StepsUs = Field(0.0, description="commands what is due so much later")


class Parameters(Timing):
    """Scene keys."""

    profile_n: tuple[law.Force, ...] = Field(
        (), max_length=1_000_000, description="forces, one a sample"
    )

    @model_validator(mode="after")
    def _some(self) -> Self:
        if not self.profile_n:
            raise ValueError(
                "controller.profile_n is empty; law 'profile' needs one force (N) a sample"
            )
        return self


class State:
    """What the law remembers; `trigger` is the sample at which the contact began."""

    mode: int = law.IDLE
    delay: int = 0
    trigger: int = 0


class Constants(NamedTuple):
    """What the compiled functions know; `profile` in N, one a sample."""

    profile: np.ndarray
    lead_samples: int
    contact_level: float = 0.0  # samples up to here are in contact


def played(forces, keys, about: law.LawContext) -> Constants:
    """Constants for forces (N) one a sample, after the delay that the keys ask for."""
    late = np.zeros(about.samples(keys.delay_us) if len(forces) else 0)
    return Constants(np.concatenate([late, forces]), about.samples(keys.lead_us))


def prepare(keys, about: law.LawContext) -> Constants:
    """Constants for the forces of the scene."""
    return played(keys.profile_n, keys, about)


def force_bound(keys) -> law.ForceBound:
    """The largest of the forces."""
    return law.ForceBound(force_n=max(map(abs, keys.profile_n)))


@law.kernel
def playing(p, s, i):
    """Force of sample `i` and whether there are more."""
    at = i - s.trigger + p.lead_samples
    if at >= p.profile.size:
        return 0.0, False
    return p.profile[at], True


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    in_contact = samples[i] <= p.contact_level
    if s.mode == law.IDLE and in_contact:
        s.mode = law.ACTING
        s.trigger = i
    if s.mode == law.ACTING:
        force, goes_on = playing(p, s, i)
        if not goes_on:
            s.mode = law.SPENT if in_contact else law.IDLE
        return force
    if s.mode == law.SPENT and not in_contact:
        s.mode = law.IDLE
    return 0.0


def known_ahead(p, s, samples, i):
    """All that is left of the forces, and the zero after them."""
    if s.mode != law.ACTING:
        return 0
    return max(s.trigger + p.profile.size - p.lead_samples - i, 0)


def command_ahead(p, s, samples, i, j):
    """Force of the later sample `j`, N."""
    return playing(p, s, j)[0]


def trigger_level(p, s):
    """Without contact there will be no force."""
    return p.contact_level if s.mode == law.IDLE else law.NO_TRIGGER
