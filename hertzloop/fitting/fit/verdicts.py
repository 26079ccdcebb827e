"""Verdicts on keys and on the model, and the limits behind them."""

import math
from enum import StrEnum

WIDEST = 0.30  # relative half-width of an identified key
NORMAL = 1.959963984540054  # 95 %
OPEN = "open"  # an end of an interval that is open, in text
_NO_BOUND = 10.0  # half-widths of logarithms beyond this mean nothing


def half_width(sd: float) -> float:
    """Return half the 95 % interval over the value, by the standard deviation of the logarithm; inf
    if nothing is known."""
    return math.sinh(NORMAL * sd) if NORMAL * sd < _NO_BOUND else math.inf


class KeyVerdict(StrEnum):
    """What a fit knows of a key."""

    IDENTIFIED = "identified"
    ONE_SIDED = "one-sided"
    NOT_IDENTIFIABLE = "not identifiable"
    AT_BOUND = "at its bound"


class ModelVerdict(StrEnum):
    """Whether the class of models fits the records."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"
    CANNOT_TELL = "cannot tell"
