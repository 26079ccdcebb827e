"""The published law: a copy of the contact force, delayed until the sphere hardly falls any more.

In contact the law watches the slope of the penetration. Once that rises above `v_thr_m_s`, the
time since the contact's start is latched as the delay, and from then on the law commands
kappa s p^(3/2) of the penetration p that long ago, until the stored contact is over.
"""

from pydantic import Field

from hertzloop.controller import law
from hertzloop.controller.laws._threshold import (  # noqa: F401
    Constants,
    State,
    constants_with,
    follow_contact,
    hertz,
    slope_weights,
    stored,
    watch,
)

latches = True  # `s.delay` is what the law has latched: events and metrics show it
not_linear = "it waits for a threshold and then repeats a stored contact force"


class Parameters(law.Keys):
    """Scene keys."""

    kappa: law.Gain = Field(0.8, description="share of the contact force")
    v_thr_m_s: float = Field(-0.25, ge=-1e3, le=1e3, description="slope that latches the delay")
    lead_us: law.StepsUs = Field(0.0, description="commands what is due so much later")


def prepare(keys, about: law.LawContext, window: int = 2) -> Constants:
    """Constants for a slope over `window` samples."""
    weights = slope_weights(window, about.sample_s)
    lead = about.samples(keys.lead_us)
    return Constants(
        keys.kappa,
        keys.v_thr_m_s,
        about.stiffness,
        about.sample_s,
        lead,
        weights,
    )


def force_bound(keys) -> law.ForceBound:
    """A share of the contact force, as smooth as that unless it starts in its midst."""
    return law.ForceBound(share=abs(keys.kappa), copies=keys.lead_us == 0.0)


def tune(about: law.LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    speed = about.impact_speed_m_s
    return {"kappa": (-1.0, 2.0), "v_thr_m_s": (-1.05 * speed, 0.5 * speed)}


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    follow_contact(p, s, samples, i)
    watch(p, s, samples, i)
    if s.mode != law.ACTING:
        return 0.0
    xi = stored(p, s, samples, i)
    if xi > p.contact_level:
        s.mode = law.WATCHING if s.in_contact else law.IDLE
        return 0.0
    return hertz(p, xi)


def known_ahead(p, s, samples, i):
    """As many samples as lie between the stored one and now, or the stored contact has left."""
    if s.mode != law.ACTING:
        return 0
    back = max(s.delay - p.lead_samples, 0)
    for ahead in range(1, back + 1):
        if stored(p, s, samples, i + ahead) > p.contact_level:
            return ahead
    return back


def command_ahead(p, s, samples, i, j):
    """Force of sample `j`, which does not depend on samples after `i`; N."""
    xi = stored(p, s, samples, j)
    return 0.0 if xi > p.contact_level else hertz(p, xi)


def trigger_level(p, s):
    """Without contact there will be no force."""
    return p.contact_level if s.mode == law.IDLE else law.NO_TRIGGER
