"""Answers the penetration that a local model expects when the force will act: latency is paid for.

Below `watch_level` the law asks a model of the sphere on an infinite plate when the slope will
pass the threshold; it then commands what the published law would command that much later.
"""

import math
from typing import Any

from pydantic import Field

from hertzloop.controller import law
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws._local_model import predict_contact
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    State,
    command_ahead,
    constants_with,
    follow_contact,
    hertz,
    known_ahead,
    latches,
    slope_weights,
    stored,
)

not_linear = "it fits a model of the flight and of the contact to the samples"


class Parameters(law.Keys):
    """Scene keys."""

    kappa: law.Gain = Field(0.8, description="share of the contact force")
    v_thr_m_s: float = Field(-0.25, ge=-1e3, le=1e3, description="slope that latches the delay")
    window_samples: int = Field(4, ge=2, le=1000, description="samples that the slope needs")


# Those of the published law; below `watch_level` (m) the law watches.
Constants = constants_with("watch_level", "mass_kg", "impedance_n_s_m")


def prepare(keys, about: law.LawContext) -> Any:
    """Constants for the run's latency."""
    return Constants(
        keys.kappa,
        keys.v_thr_m_s,
        about.stiffness,
        about.sample_s,
        lead_samples=round(about.loop_delay_s / about.sample_s),
        slope_weights=slope_weights(keys.window_samples, about.sample_s),
        contact_level=0.0,
        watch_level=max(2.0 * about.impact_speed_m_s * about.loop_delay_s, 0.0),
        mass_kg=about.sphere_mass_kg,
        impedance_n_s_m=about.impedance_n_s_m,
    )


def force_bound(keys) -> law.ForceBound:
    """A share of the contact force."""
    return law.ForceBound(share=abs(keys.kappa))


def tune(about: law.LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return slope_threshold.tune(about) | {"window_samples": (2, 12)}


@law.kernel
def expects_threshold(p, s, samples, i):
    """Whether the slope will have passed the threshold when the force acts; latches the delay."""
    if i + 1 < p.slope_weights.size:
        return False
    _, _, touches, crosses = predict_contact(p, samples, i, p.lead_samples)
    if crosses == math.inf:
        return False
    since = i - s.contact_start if s.in_contact else -touches
    s.delay = max(math.ceil(since + max(crosses, -since)), 0)
    return True


@law.kernel
def due(p, s, samples, i):
    """Command for a force that acts `lead_samples` later, and whether it goes on: for as long as
    there is contact then, or will be again."""
    if s.delay < p.lead_samples:
        xi, speed, _, _ = predict_contact(p, samples, i, p.lead_samples - s.delay)
        if xi > p.contact_level:
            return 0.0, speed < 0.0
        return hertz(p, xi), True
    at = i - max(s.delay - p.lead_samples, 0)
    if samples[at] > p.contact_level:
        return 0.0, at > 0 and samples[at] < samples[at - 1]
    return hertz(p, samples[at]), True


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    follow_contact(p, s, samples, i)
    near = s.in_contact or samples[i] <= p.watch_level
    if s.mode == law.IDLE and near:
        s.mode = law.WATCHING
    if s.mode == law.WATCHING:
        if not near:
            s.mode = law.IDLE
        elif expects_threshold(p, s, samples, i):
            s.mode = law.ACTING
    if s.mode == law.ACTING:
        force, goes_on = due(p, s, samples, i)
        if not goes_on:
            s.mode = law.SPENT if s.in_contact else law.IDLE
        return force
    if s.mode == law.SPENT and not s.in_contact:
        s.mode = law.IDLE
    return 0.0


def trigger_level(p, s):
    """Far from the plate there will be no force."""
    return p.watch_level if s.mode == law.IDLE else law.NO_TRIGGER
