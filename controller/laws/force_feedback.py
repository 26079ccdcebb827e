"""A share of the contact force, as sampled."""

from typing import NamedTuple

from pydantic import Field

from hertzloop.controller.law import ACTING, IDLE, About, Gain, Keys, Reach, Response

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
    dead_zone: float  # samples up to here count as zero


def dead_zone(about: About) -> float:
    """Zero need not be a level of the converter; the nearest one is half a step off at most."""
    return 0.5000001 * about.converter_step


def prepare(keys, about: About) -> Constants:
    """Constants of the function."""
    return Constants(keys.kappa, dead_zone(about))


def transfer_function(keys, p) -> Response:
    """A gain."""
    return Response(p.gain)


def reach(keys) -> Reach:
    """A share of the contact force."""
    return Reach(share=abs(keys.kappa))


def tune(about: About) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return {"kappa": (-0.5, 1.2)}


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    value = samples[i]
    if abs(value) <= p.dead_zone:
        value = 0.0
    if value != 0.0:
        s.mode = ACTING
    return p.gain * value
