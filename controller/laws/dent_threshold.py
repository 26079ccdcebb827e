"""The published law for a plate that yields: it knows the dent.

The law keeps the deepest penetration p_m that it has seen, over all contacts. Coming back from
there the contact is that of a flatter dent: no force below the dent p_r, s_u (p - p_r)^(3/2) above
it (Thornton 1997), and contact begins and ends at p_r. Where the plate does not yield, every
force is that of `slope_threshold`.
"""

import math
from typing import Any

from hertzloop.controller.law import ACTING, IDLE, NO_PROMISE, WATCHING, LawContext, kernel
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws._threshold import refuse_without_hertz
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    Parameters,
    constants_with,
    latches,
    not_linear,
    reach,
    slope_weights,
    stored,
    tune,
    watch,
)

models_yield = True


class State:
    """What the law remembers; `deepest` penetration so far, `before` the present contact, and
    `stored_deepest` up to the sample that is answered, m."""

    mode: int = IDLE
    delay: int = 0
    contact_start: int = 0
    in_contact: bool = False
    deepest: float = 0.0
    before: float = 0.0
    stored_deepest: float = 0.0


# Those of the published law, and the penetration at which the contact begins to yield.
Constants = constants_with("yield_depth_m")


def prepare(keys, about: LawContext) -> Any:
    """Constants of the published law and of the contact. Raises LawError as `predicted`."""
    refuse_without_hertz(about, "dent_threshold")
    return Constants(*slope_threshold.prepare(keys, about), about.yield_depth_m)


@kernel
def load(p, depth):
    """Force of a penetration never reached before, N: beyond yield on the tangent."""
    if depth <= p.yield_depth_m:
        return p.stiffness * depth * math.sqrt(depth)
    root = math.sqrt(p.yield_depth_m)
    return p.stiffness * root * (p.yield_depth_m + 1.5 * (depth - p.yield_depth_m))


@kernel
def reloading(p, deepest):
    """Stiffness s_u of the dent that `deepest` has left, N/m^1.5."""
    return p.stiffness * math.sqrt(p.stiffness * deepest * math.sqrt(deepest) / load(p, deepest))


@kernel
def dent(p, deepest):
    """Depth p_r of the dent that `deepest` has left, m."""
    if deepest <= p.yield_depth_m:
        return 0.0
    return deepest - (load(p, deepest) / reloading(p, deepest)) ** (2.0 / 3.0)


@kernel
def contact_force(p, depth, deepest):
    """Force at a penetration, the deepest so far being `deepest`, N."""
    if depth >= deepest or deepest <= p.yield_depth_m:
        return load(p, max(depth, 0.0))
    above = max(depth - dent(p, deepest), 0.0)
    return reloading(p, deepest) * above * math.sqrt(above)


@kernel
def follow_dent(p, s, samples, i):
    """Note where contacts begin, and how deep they go; they begin and end at the dent."""
    in_contact = samples[i] <= -dent(p, s.deepest)
    if in_contact and not s.in_contact:
        s.contact_start = i
        s.before = s.deepest
    s.in_contact = in_contact
    s.deepest = max(s.deepest, -samples[i])


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    was = s.mode
    follow_dent(p, s, samples, i)
    watch(p, s, samples, i)
    if s.mode != ACTING:
        return 0.0
    if was != ACTING:
        s.stored_deepest = s.before
    depth = -stored(p, s, samples, i)
    if depth < dent(p, s.stored_deepest):
        s.mode = WATCHING if s.in_contact else IDLE
        return 0.0
    force = contact_force(p, depth, s.stored_deepest)
    s.stored_deepest = max(s.stored_deepest, depth)
    return p.kappa * force


def quiet_level(p, s):
    """Without contact there will be no force."""
    return -dent(p, s.deepest) if s.mode == IDLE else NO_PROMISE
