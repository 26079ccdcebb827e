"""A share of the contact force, as sampled."""

from typing import NamedTuple

from pydantic import Field

from hertzloop.controller.law import ACTING, IDLE, ForceBound, Gain, Keys, LawContext, Response

senses = "contact_force"


class Parameters(Keys):
    """Scene keys."""

    kappa: Gain = Field(0.8, description="share of the contact force")


class State:
    """The mode says since when there is a command; it stays."""

    mode: int = IDLE
    delay: int = 0


class Constants(NamedTuple):
    """What the compiled function knows; `gain` in N per unit of the samples."""

    gain: float


def prepare(keys, about: LawContext) -> Constants:
    """Constants of the function."""
    return Constants(keys.kappa)


def transfer_function(keys, p) -> Response:
    """A gain."""
    return Response(p.gain)


def force_bound(keys) -> ForceBound:
    """A share of the contact force."""
    return ForceBound(share=abs(keys.kappa))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return {"kappa": (-0.5, 1.2)}


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    value = samples[i]
    if value != 0.0:
        s.mode = ACTING
    return p.gain * value
