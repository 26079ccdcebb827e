"""Gain margin and peak sensitivity of a loop, from where its gain is real and negative."""

import math

import numpy as np

from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import NO_GAIN, Loop

_NO_GAIN = 1e-4  # a gain margin below it depends on the damping that `damped` adds


def phase_crossings(loop: Loop, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles where L with its delay is real and negative, and |L| there."""
    theta, full = loop.table.theta, np.exp(loop.table.log_gain)
    full = full * np.exp(-1j * delay * theta)
    if len(theta) < 4 * delay:  # the delay alone turns faster than the grid
        more = np.linspace(0.0, math.pi, 8 * delay)
        theta = np.concatenate([theta, more])
        full = np.concatenate([full, loop.delayed(more, delay)])
        order = np.argsort(theta)
        theta, full = theta[order], full[order]
    change = np.flatnonzero((full.imag[1:] > 0) != (full.imag[:-1] > 0))
    low, high, up = theta[change], theta[change + 1], full.imag[change] > 0
    for _ in range(45):
        middle = 0.5 * (low + high)
        same = (loop.delayed(middle, delay).imag > 0) == up
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    at = np.concatenate([0.5 * (low + high), [0.0, math.pi]])
    there = loop.delayed(at, delay).real
    return at[there < 0.0], -there[there < 0.0]


def gain_margin(loop: Loop, delay: int) -> float | None:
    """Return the factor up to which every smaller gain is stable too; None without limit."""
    if loop.table.outside:
        return None
    size = phase_crossings(loop, delay)[1]
    if not len(size) or not size.max() > 2.0 * NO_GAIN:
        return None
    found = 1.0 / float(size.max())
    # A mode without damping tolerates no gain of the wrong sign; `damped` gave it a little.
    return 0.0 if found < _NO_GAIN else found


def needle_angles(loop: Loop, delay: int) -> np.ndarray:
    """Return angles from 0 to pi, rising, with one at every narrow peak of the closed loop."""
    parts = [loop.table.theta, phase_crossings(loop, delay)[0]]
    poles = closed_loop_poles(loop.plant, loop.law, delay)
    if poles is not None:  # a needle of the sensitivity stands at every pole
        parts.append(np.abs(np.angle(poles)))
    theta = np.concatenate(parts)
    return np.unique(np.concatenate([theta, np.linspace(0.0, math.pi, 8 * delay + 2)]))


def sensitivity(loop: Loop, delay: int) -> tuple[float, float]:
    """Return the largest |S| and 1/max|S - 1/2|: from the grid and a local search."""
    theta = needle_angles(loop, delay)

    def both(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = 1.0 / (1.0 + loop.delayed(at, delay))
        return np.abs(s), np.abs(s - 0.5)

    found = []
    values = both(theta)
    for kind in (0, 1):
        best = np.argsort(-values[kind])[:30]
        low = theta[np.maximum(best - 1, 0)]
        high = theta[np.minimum(best + 1, len(theta) - 1)]
        for _ in range(60):
            a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
            left = both(a)[kind] > both(b)[kind]
            low, high = np.where(left, low, a), np.where(left, b, high)
        found.append(max(float(values[kind].max()), float(both(0.5 * (low + high))[kind].max())))
    return found[0], 1.0 / found[1]
