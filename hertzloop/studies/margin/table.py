"""Count closed-loop poles outside the unit circle at every latency, from one table of arcs.

Where |L| > 1 on the unit circle, the phase of L at both ends of such an arc tells how often L goes
round -1 there. Latency only turns these phases, so the table is made once (Nyquist's criterion).
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.studies.margin.law_filters import LawFilter
from hertzloop.studies.margin.linear import PoleForm
from hertzloop.studies.margin.poles import sums_at

_POINTS = 14  # on the tangent around a pole
_GAP_POINTS = 5
_MOST_ROUNDS = 24
_NEAR, _ELSEWHERE = 0.05, 0.5  # largest error of an interpolated log L
_MOST_TURN = 1.2  # rad between two points
_HIDDEN_ROUNDS = 6
_HALVINGS = 60
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
    """Arcs of a loop gain, its open-loop poles outside the circle, the grid with values, and the
    function that evaluates it between them."""

    arcs: tuple[GainArc, ...]
    outside: int
    theta: np.ndarray
    log_gain: np.ndarray  # complex: log |L| and the unwrapped phase
    log_of: "FrequencyResponse"

    def gain(self, theta: np.ndarray, delay: int) -> np.ndarray:
        """Return L with a delay in samples at angles from 0 to pi, shape (points,)."""
        found = np.exp(self.log_of(theta)[0] - 1j * delay * theta)
        real = (theta == 0.0) | (theta == math.pi)
        return np.where(real, found.real, found)

    def unstable(self, delay: np.ndarray) -> np.ndarray:
        """Return the number of closed-loop poles outside the unit circle, by delay in samples."""
        delay = np.asarray(delay, float)
        found = np.full(delay.shape, float(self.outside))
        for arc in self.arcs:
            found -= arc.turns(delay)
        return np.round(found).astype(int)


class FrequencyResponse:
    """The loop gain L = -C P without latency on the upper unit circle."""

    def __init__(self, plant: PoleForm, law: LawFilter) -> None:
        self.plant, self.law = plant, law
        self._poles, self._residues = plant.both_of_pairs()

    def __call__(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return log L and its slope by the angle, complex, at angles from 0 to pi."""
        z = np.exp(1j * theta)
        p, p_1, _ = sums_at(z, self._poles, self._residues, np.full(len(z), -1))
        near, (b_1, b_2) = 1.0 / z, self.plant.fir
        p += near * (b_1 + b_2 * near)
        p_1 -= near * near * (b_1 + 2.0 * b_2 * near)
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
    poles = poles[np.abs(poles) > 1e-6]
    s = np.log(poles)
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


def make_table(plant: PoleForm, law: LawFilter) -> NyquistTable:
    """Return the table of the loop gain -C P without latency.

    An interval is halved until the cubic through log L and its slope at both ends predicts the
    middle. Where this cubic passes |L| = 1 and the ends do not tell, a point is added.
    """
    log_of = FrequencyResponse(plant, law)
    poles = np.concatenate([plant.poles, law.poles[law.poles.imag >= -1e-14]])
    theta = grid(poles)
    value, slope = log_of(theta)
    open_ = np.ones(len(theta) - 1, bool)
    for _ in range(_MOST_ROUNDS):
        middle = 0.5 * (theta[:-1] + theta[1:])
        which = np.flatnonzero(open_ & (middle > theta[:-1]) & (middle < theta[1:]))
        if not len(which):
            break
        found, found_slope = log_of(middle[which])
        width = theta[which + 1] - theta[which]
        rise = value[which + 1] - value[which]
        bend = 0.125 * width * (slope[which] - slope[which + 1])
        away = value[which] + 0.5 * rise + bend - found
        # The phase may be off by whole turns, and half of that in the middle.
        away_phase = np.minimum(np.abs(_wrapped(away.imag)), np.abs(_wrapped(away.imag + math.pi)))
        close = np.minimum(np.abs(found.real), np.abs(value[which].real))
        close = np.minimum(close, np.abs(value[which + 1].real)) < 1.0
        bad = np.hypot(away.real, away_phase) > np.where(close, _NEAR, _ELSEWHERE)
        for step in (found - value[which], value[which + 1] - found):
            bad |= np.abs(_wrapped(step.imag)) > _MOST_TURN
        theta = np.insert(theta, which + 1, middle[which])
        value = np.insert(value, which + 1, found)
        slope = np.insert(slope, which + 1, found_slope)
        flags = np.zeros(len(open_), bool)
        flags[which] = bad
        open_ = np.insert(flags, which + 1, bad)
    for i in range(_HIDDEN_ROUNDS):
        hidden = _hidden(theta, value.real, slope.real, _NEAR * 0.1**i)
        if not len(hidden):
            break
        theta = np.unique(np.concatenate([theta, hidden]))
        value, slope = log_of(theta)
    size = value.real
    turns = np.concatenate([[0.0], np.cumsum(_wrapped(np.diff(value.imag)))])
    phase = value[0].imag + turns
    above = size > 0.0
    change = np.flatnonzero(above[1:] != above[:-1])
    edge, edge_phase = _edges(log_of, theta, above, change)
    edge_phase = phase[change] + _wrapped(edge_phase - phase[change])
    arcs = []
    start, start_phase = (0.0, float(phase[0])) if above[0] else (math.nan, math.nan)
    for i, j in enumerate(change):
        if above[j]:
            arcs.append(GainArc(start, float(edge[i]), start_phase, float(edge_phase[i])))
        else:
            start, start_phase = float(edge[i]), float(edge_phase[i])
    if above[-1]:
        arcs.append(GainArc(start, math.pi, start_phase, float(phase[-1])))
    outside = poles[np.abs(poles) > 1.0]
    count = int(sum(1 if abs(p.imag) < 1e-15 else 2 for p in outside))
    return NyquistTable(tuple(arcs), count, theta, size + 1j * phase, log_of)


def _edges(
    log_of: FrequencyResponse, theta: np.ndarray, above: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where |L| = 1 in the intervals `change`, and the phase there, by Newton's method that
    falls back on halving."""
    low, high = theta[change].copy(), theta[change + 1].copy()
    edge = 0.5 * (low + high)
    value, slope = log_of(edge)
    for _ in range(_HALVINGS):
        same = (value.real > 0.0) == above[change]
        low, high = np.where(same, edge, low), np.where(same, high, edge)
        with np.errstate(all="ignore"):
            step = edge - value.real / slope.real
        after = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        if np.all(np.abs(after - edge) <= 1e-16 + 4e-16 * edge):
            break
        edge = after
        value, slope = log_of(edge)
    return edge, value.imag


def _hidden(theta: np.ndarray, size: np.ndarray, slope: np.ndarray, error: float) -> np.ndarray:
    """Return extrema of the cubics through log |L| that lie beyond |L| = 1, or within `error` of
    it, while both ends lie on this side of it."""
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
