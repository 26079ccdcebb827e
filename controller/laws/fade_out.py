"""The published law, but the force fades as soon as the contact is over."""

from typing import Any

from pydantic import Field

from hertzloop.common.elementary_kernels import sine_and_cosine_of_pi
from hertzloop.controller.law import ACTING, IDLE, WATCHING, ForceBound, LawContext, StepsUs, kernel
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    State,
    constants_with,
    follow_contact,
    hertz,
    latches,
    not_linear,
    stored,
    trigger_level,
    watch,
)


class Parameters(slope_threshold.Parameters):
    """Scene keys."""

    fade_us: StepsUs = Field(10.0, description="length of the fading; 0 ends the force at once")


# Those of the published law, and the length of the fading.
Constants = constants_with("fade_samples")


def prepare(keys, about: LawContext) -> Any:
    """Constants of the published law and of the fading."""
    return Constants(*slope_threshold.prepare(keys, about), about.samples(keys.fade_us))


def force_bound(keys) -> ForceBound:
    """A share of the contact force."""
    return ForceBound(share=abs(keys.kappa))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return slope_threshold.tune(about) | {"fade_us": (0.0, 50.0)}


@kernel
def left_over(p, s, i):
    """Share of the command that is left so long after the contact's end."""
    if s.in_contact:
        return 1.0
    after = i - s.left + 1
    if after > p.fade_samples:
        return 0.0
    return 0.5 + 0.5 * sine_and_cosine_of_pi(after / (p.fade_samples + 1))[1]


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    follow_contact(p, s, samples, i)
    watch(p, s, samples, i)
    if s.mode != ACTING:
        return 0.0
    xi, share = stored(p, s, samples, i), left_over(p, s, i)
    if xi > p.contact_level:
        force, goes_on = 0.0, False
    else:
        force, goes_on = hertz(p, xi) * share, share > 0.0
    if not goes_on:
        s.mode = WATCHING if s.in_contact else IDLE
    return force
