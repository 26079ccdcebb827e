"""Against the velocity of the contact point, from its acceleration by a leaking integral."""

import math
from typing import NamedTuple

from pydantic import Field

from hertzloop.common.elementary_kernels import exp
from hertzloop.common.uncompiled import plain
from hertzloop.controller.law import ACTING, IDLE, LawContext, Response
from hertzloop.controller.laws import force_feedback
from hertzloop.controller.laws.force_feedback import force_bound  # noqa: F401

senses = "acceleration"


class Parameters(force_feedback.Parameters):
    """Scene keys."""

    leak_hz: float = Field(20.0, ge=0.0, le=1e6, description="corner of the integral")


class State:
    """What the law remembers; `integral` of the samples."""

    mode: int = IDLE
    delay: int = 0
    integral: float = 0.0


class Constants(NamedTuple):
    """What the compiled function knows; `keep`: share of the integral left by the next sample."""

    gain: float
    keep: float
    sample_s: float


def prepare(keys, about: LawContext) -> Constants:
    """Constants of the function."""
    keep = plain(exp)(-2.0 * math.pi * keys.leak_hz * about.sample_s)
    gain = -keys.kappa * about.impedance_n_s_m
    return Constants(gain, keep, about.sample_s)


def transfer_function(keys, p) -> Response:
    """The leaking integral, scale z/(z - keep) = scale + scale keep/(z - keep)."""
    scale = p.gain * p.keep * p.sample_s
    return Response(scale, (p.keep,), (scale * p.keep,))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return force_feedback.tune(about) | {"leak_hz": (1.0, 2000.0)}


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    s.integral = p.keep * (s.integral + p.sample_s * samples[i])
    if s.integral != 0.0:
        s.mode = ACTING
    return p.gain * s.integral
