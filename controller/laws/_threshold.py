"""What the laws share that watch for a threshold of the slope, and answer stored samples."""

import math
from collections import namedtuple
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hertzloop.controller.law import ACTING, IDLE, WATCHING, kernel


class State:
    """What the law remembers; `contact_start` and `left` are samples."""

    mode: int = IDLE
    delay: int = 0
    contact_start: int = 0
    in_contact: bool = False
    left: int = 0


class Constants(NamedTuple):
    """What the compiled functions know; `slope_weights` (1/s) of the last samples."""

    kappa: float
    v_thr_m_s: float
    stiffness: float
    sample_s: float
    lead_samples: int
    slope_weights: np.ndarray
    contact_level: float = 0.0  # samples up to here are in contact


def constants_with(*names: str) -> Any:
    """A NamedTuple of these constants and more, which follow them."""
    return namedtuple("Constants", (*Constants._fields, *names))


@lru_cache(maxsize=64)
def slope_weights(window: int, sample_s: float) -> np.ndarray:
    """Weights that make the slope of the least-squares line of the last samples."""
    place = np.arange(window) - 0.5 * (window - 1)
    return np.asarray(place / (np.sum(place * place) * sample_s))


@kernel
def slope(p, samples, i):
    """Slope at the middle of the window that ends at sample `i`, m/s."""
    weights = p.slope_weights
    if weights.size == 2:
        return (samples[i] - samples[i - 1]) / p.sample_s
    total = 0.0
    for k in range(weights.size):
        total += weights[k] * samples[i + 1 - weights.size + k]
    return total


@kernel
def follow_contact(p, s, samples, i):
    """Note where contacts begin and end."""
    in_contact = samples[i] <= p.contact_level
    if in_contact and not s.in_contact:
        s.contact_start = i
    if s.in_contact and not in_contact:
        s.left = i
    s.in_contact = in_contact


@kernel
def watch(p, s, samples, i):
    """From the contact's start to the moment at which the delay is latched."""
    if s.mode == IDLE and s.in_contact:
        s.mode = WATCHING
    if s.mode == WATCHING:
        if not s.in_contact:
            s.mode = IDLE
        elif i + 1 >= p.slope_weights.size and slope(p, samples, i) > p.v_thr_m_s:
            s.mode = ACTING
            s.delay = i - s.contact_start


@kernel
def hertz(p, xi):
    """kappa s p^(3/2), N."""
    depth = max(-xi, 0.0)
    return p.kappa * p.stiffness * depth * math.sqrt(depth)


@kernel
def stored(p, s, samples, i):
    """The sample that the command of sample `i` answers."""
    return samples[i - max(s.delay - p.lead_samples, 0)]
