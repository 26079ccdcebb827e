"""Count closed-loop poles outside the unit circle at every latency, from one table of arcs.

Where |L| > 1 on the unit circle, the phase of L at both ends of such an arc tells how often L goes
round -1 there. Latency only turns these phases, so the table is made once (Nyquist's criterion).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hertzloop.studies.margin.linear import TransferFunction

_POINTS = 14  # on the tangent around a pole
_GAP_POINTS = 5
_MOST_ROUNDS = 40
_NEAR, _ELSEWHERE = 0.05, 0.5  # largest error of an interpolated log L
_MOST_TURN = 1.2  # rad between two points
_FAINT = -20.0  # log |L| of a loop gain that may be rounding alone, as between poles and zeros at 1
_HIDDEN_ROUNDS = 6
_HALVINGS = 55
Sampled = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # values and slopes at angles
NO_GAIN = 1e-300  # stands for a loop gain of zero, of which there is no logarithm


@dataclass(frozen=True)
class GainArc:
    """A stretch of the upper unit circle with |L| > 1: its ends (rad/sample) and phases (rad),
    unwrapped, of L without latency."""

    start: float
    end: float
    phase_start: float
    phase_end: float

    def turns(self, delay: np.ndarray) -> np.ndarray:
        """Return how often L and its mirror image pass the negative axis here, by delay."""
        a = self.phase_start - delay * self.start
        b = self.phase_end - delay * self.end
        if self.start == 0.0 and self.end == math.pi:
            return np.round((b - a) / math.pi)
        if self.start == 0.0:
            return _level(b) - _level(2.0 * a - b)
        if self.end == math.pi:
            return _level(2.0 * b - a) - _level(a)
        return 2.0 * (_level(b) - _level(a))


def _level(phase: np.ndarray) -> np.ndarray:
    return np.floor((phase + math.pi) / (2.0 * math.pi))


@dataclass(frozen=True)
class NyquistTable:
    """Arcs of a loop gain, its open-loop poles outside the circle, and the grid with values."""

    arcs: tuple[GainArc, ...]
    outside: int
    theta: np.ndarray
    log_gain: np.ndarray  # complex: log |L| and the unwrapped phase

    def unstable(self, delay: np.ndarray) -> np.ndarray:
        """Return the number of closed-loop poles outside the unit circle, by delay in samples."""
        delay = np.asarray(delay, float)
        found = np.full(delay.shape, float(self.outside))
        for arc in self.arcs:
            found -= arc.turns(delay)
        return np.round(found).astype(int)


@dataclass(frozen=True)
class Loop:
    """The loop gain L = -C P of a plant P and a law C, without the whole samples of delay."""

    plant: TransferFunction
    law: TransferFunction

    @cached_property
    def table(self) -> NyquistTable:
        """The table of the loop gain, made when it is first asked for."""
        return _make_table(self)

    def gain(self, z: np.ndarray) -> np.ndarray:
        """Return L at complex `z`."""
        return -self.law.at(z) * self.plant.at(z)

    def delayed(self, theta: np.ndarray, delay: int) -> np.ndarray:
        """Return L with a delay in samples at angles from 0 to pi, shape (points,)."""
        found = np.exp(self.log_gain(theta)[0] - 1j * delay * theta)
        return np.where((theta == 0.0) | (theta == math.pi), found.real, found)

    def log_gain(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return log L and its slope by the angle, complex, at angles from 0 to pi."""
        z = np.exp(1j * theta)
        p, p_1 = self.plant.with_slope(z)
        c, c_1 = self.law.with_slope(z)
        gain = -c * p
        if not np.all(np.isfinite(gain)):
            raise FloatingPointError("the loop gain is not finite on the unit circle")
        real = (theta == 0.0) | (theta == math.pi)
        gain = np.where(real, gain.real, gain)
        gain = np.where(gain == 0.0, NO_GAIN, gain)
        with np.errstate(all="ignore"):
            change = 1j * z * (c_1 / c + p_1 / p)
        return np.log(gain.astype(complex)), np.where(np.isfinite(change), change, 0.0)


def grid(poles: np.ndarray) -> np.ndarray:
    """Return angles from 0 to pi that are dense around every pole, shape (points,)."""
    s = np.log(poles[(np.abs(poles) > 1e-6) & (poles.imag >= -1e-14)])
    centre, width = np.abs(s.imag), np.maximum(np.abs(s.real), 1e-13)
    near = np.tan(np.linspace(-1.5, 1.5, _POINTS))
    order = np.sort(np.concatenate([[0.0], centre, [math.pi]]))
    gap = np.diff(order)
    share = np.geomspace(1e-3, 0.5, _GAP_POINTS)
    parts = [
        (centre[:, None] + width[:, None] * near).ravel(),
        (order[:-1, None] + gap[:, None] * share).ravel(),
        (order[1:, None] - gap[:, None] * share).ravel(),
        np.linspace(0.0, math.pi, 400),
    ]
    theta = np.unique(np.concatenate(parts))
    theta = theta[(theta > 0.0) & (theta < math.pi)]
    return np.concatenate([[0.0], theta, [math.pi]])


class SampledResponse(NamedTuple):
    """A response at rising angles, rad: its values, and their slopes by the angle, last axis."""

    theta: np.ndarray
    value: np.ndarray
    slope: np.ndarray

    def with_more(self, theta: np.ndarray, at: Sampled) -> "SampledResponse":
        """Return them with the response `at` more angles, which are rising and not there yet."""
        where = np.searchsorted(self.theta, theta)
        return SampledResponse(
            np.insert(self.theta, where, theta),
            *(np.insert(old, where, new, -1) for old, new in zip(self[1:], at(theta), strict=True)),
        )

    def part(self, which: Any) -> "SampledResponse":
        """Return some of them."""
        return SampledResponse(self.theta[which], self.value[..., which], self.slope[..., which])


def refined(
    theta: np.ndarray,
    at: Sampled,
    unsure: Callable[[SampledResponse, SampledResponse, SampledResponse], np.ndarray],
) -> SampledResponse:
    """Return a response sampled so that its middles follow from the ends of all intervals.

    Args:
        theta: first angles, rising.
        at: the response.
        unsure: tells, from the left ends, the middles and the right ends of intervals, in which
            halves of these more middles are needed.
    """
    samples = SampledResponse(theta, *at(theta))
    open_ = np.ones(len(theta) - 1, bool)
    for _ in range(_MOST_ROUNDS):
        theta = samples.theta
        middle = 0.5 * (theta[:-1] + theta[1:])
        which = np.flatnonzero(open_ & (middle > theta[:-1]) & (middle < theta[1:]))
        if not len(which):
            break
        samples = samples.with_more(middle[which], at)
        new = which + 1 + np.arange(len(which))
        bad = unsure(samples.part(new - 1), samples.part(new), samples.part(new + 1))
        open_ = np.zeros(len(samples.theta) - 1, bool)
        open_[new - 1] = open_[new] = bad
    return samples


def middle_of_cubic(left: SampledResponse, right: SampledResponse) -> np.ndarray:
    """Return the middles of the cubics through values and slopes at both ends of intervals."""
    bend = 0.125 * (right.theta - left.theta) * (left.slope - right.slope)
    return np.asarray(0.5 * (left.value + right.value) + bend)


def _unsure(left: SampledResponse, middle: SampledResponse, right: SampledResponse) -> np.ndarray:
    """Whether the cubic through log L does not predict the middle, or the phase turns too far;
    nothing is asked of a faint loop gain, whose rounding no cubic predicts."""
    away = middle_of_cubic(left, right) - middle.value
    # The phase may be off by whole turns, and half of that in the middle.
    away_phase = np.minimum(np.abs(_wrapped(away.imag)), np.abs(_wrapped(away.imag + math.pi)))
    sizes = np.array([part.value.real for part in (left, middle, right)])
    close = np.min(np.abs(sizes), axis=0) < 1.0
    bad = np.hypot(away.real, away_phase) > np.where(close, _NEAR, _ELSEWHERE)
    for step in (middle.value - left.value, right.value - middle.value):
        bad |= np.abs(_wrapped(step.imag)) > _MOST_TURN
    return bad & (np.max(sizes, axis=0) > _FAINT)


def _make_table(loop: Loop) -> NyquistTable:
    """Return the table of a loop gain.

    Where the cubic through log L passes |L| = 1 and the ends do not tell, a point is added.
    """
    poles = np.concatenate([loop.plant.poles, loop.law.poles])
    samples = refined(grid(poles), loop.log_gain, _unsure)
    for i in range(_HIDDEN_ROUNDS):
        hidden = np.setdiff1d(_hidden(samples, _NEAR * 0.1**i), samples.theta)
        if not len(hidden):
            break
        samples = samples.with_more(hidden, loop.log_gain)
    theta, size = samples.theta, samples.value.real
    turns = np.concatenate([[0.0], np.cumsum(_wrapped(np.diff(samples.value.imag)))])
    phase = samples.value[0].imag + turns
    above = size > 0.0
    change = np.flatnonzero(above[1:] != above[:-1])
    low, high = theta[change], theta[change + 1]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = (loop.log_gain(middle)[0].real > 0.0) == above[change]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edge = 0.5 * (low + high)
    edge_phase = phase[change] + _wrapped(loop.log_gain(edge)[0].imag - phase[change])
    ends = list(zip(edge.tolist(), edge_phase.tolist(), strict=True))
    ends = [(0.0, float(phase[0]))] * bool(above[0]) + ends
    ends += [(math.pi, float(phase[-1]))] * bool(above[-1])
    arcs = [
        GainArc(start, end, start_phase, end_phase)
        for (start, start_phase), (end, end_phase) in zip(ends[::2], ends[1::2], strict=True)
    ]
    outside = int(np.sum(np.abs(poles) > 1.0))
    return NyquistTable(tuple(arcs), outside, theta, size + 1j * phase)


def _hidden(samples: SampledResponse, error: float) -> np.ndarray:
    """Return extrema of the cubics through log |L| that lie beyond |L| = 1, or within `error` of
    it, while both ends lie on this side of it."""
    theta, size, slope = samples.theta, samples.value.real, samples.slope.real
    width = np.diff(theta)
    low, high = size[:-1], size[1:]
    s_0, s_1 = slope[:-1] * width, slope[1:] * width
    # low + s_0 x + b x^2 + a x^3 over x from 0 to 1
    a, b = 2.0 * (low - high) + s_0 + s_1, 3.0 * (high - low) - 2.0 * s_0 - s_1
    root = np.sqrt(np.maximum(b * b - 3.0 * a * s_0, 0.0))
    points = []
    with np.errstate(all="ignore"):
        q = -(b + np.where(b < 0.0, -root, root))
        for x in (q / (3.0 * a), s_0 / q):
            there = low + x * (s_0 + x * (b + x * a))
            at = theta[:-1] + x * width
            crosses = (low > 0.0) == (high > 0.0)
            crosses &= np.where(low > 0.0, there < error, there > -error)
            crosses &= (x > 0.0) & (x < 1.0) & (at > theta[:-1]) & (at < theta[1:])
            points.append(at[crosses])
    return np.concatenate(points)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return np.asarray(np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi)
