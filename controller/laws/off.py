"""No control."""

import math

from hertzloop.controller.law import ForceBound

senses = "any"
open_loop = True


def force_bound(keys) -> ForceBound:
    """Never a force."""
    return ForceBound(force_n=0.0)


def command(p, s, samples, i):
    """No force, whatever is sampled."""
    return 0.0


def trigger_level(p, s):
    """No sample is below this."""
    return -math.inf
