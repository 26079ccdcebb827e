"""The contact force through a low-pass, kept within what the actuator can do.

    hertzloop run aluminium-3mm --set controller.law=low_passed.py --set controller.full_scale_n=20

A filter that may swing beyond the actuator's limit has to come back before the force falls; this
one stops at the limit (anti-windup).
"""

import math
from typing import NamedTuple

from pydantic import Field

from hertzloop.law import ACTING, IDLE, Gain, Keys, LawContext

senses = "contact_force"


class Parameters(Keys):
    """Keys under [controller] of a scene; other keys, and values beyond bounds, are refused."""

    kappa: Gain = Field(0.8, description="share of the contact force")
    corner_hz: float = Field(20e3, ge=1.0, le=1e6, description="corner of the low-pass")


class State:
    """What the law remembers from sample to sample, and starts with."""

    mode: int = IDLE
    filtered_n: float = 0.0


class Constants(NamedTuple):
    """What `command` sees as `p`."""

    kappa: float
    share: float  # of the way to a new value that the filter goes in a sample
    limit_n: float


def prepare(keys: Parameters, about: LawContext) -> Constants:
    """Once before a run, in plain Python."""
    share = 1.0 - math.exp(-2.0 * math.pi * keys.corner_hz * about.sample_s)
    return Constants(keys.kappa, share, about.limit_n)


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `hertzloop tune` searches; without this the bounds of the keys."""
    return {"kappa": (-1.0, 2.0), "corner_hz": (1e3, 100e3)}


def command(p, s, samples, i):
    """Force (N) of sample `i`; compiled."""
    s.filtered_n += p.share * (p.kappa * samples[i] - s.filtered_n)
    s.filtered_n = min(max(s.filtered_n, -p.limit_n), p.limit_n)
    if s.filtered_n != 0.0:
        s.mode = ACTING
    return s.filtered_n
