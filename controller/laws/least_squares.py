"""The published law with the slope of a line through the last samples: less troubled by noise."""

from pydantic import Field

from hertzloop.controller.law import ForceBound, LawContext
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    State,
    command,
    command_ahead,
    known_ahead,
    latches,
    not_linear,
    trigger_level,
)


class Parameters(slope_threshold.Parameters):
    """Scene keys."""

    window_samples: int = Field(4, ge=2, le=1000, description="samples that the line goes through")


def prepare(keys, about: LawContext) -> slope_threshold.Constants:
    """Constants of the published law, with a longer window."""
    return slope_threshold.prepare(keys, about, keys.window_samples)


def force_bound(keys) -> ForceBound:
    """A share of the contact force."""
    return ForceBound(share=abs(keys.kappa))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return slope_threshold.tune(about) | {"window_samples": (2, 12)}
