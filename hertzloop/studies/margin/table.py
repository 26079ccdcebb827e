"""Count closed-loop poles outside the unit circle at every latency, from one table of arcs.

Where |L| > 1 on the unit circle, the phase of L at both ends of such an arc tells how often L goes
round -1 there. Latency only turns these phases, so the table is made once (Nyquist's criterion).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_POINTS = 24  # on the tangent around a pole
_GAP_POINTS = 8
_MOST_ROUNDS = 14
_NEAR, _ELSEWHERE = 0.05, 0.5  # largest error of an interpolated log L
_HALVINGS = 60


@dataclass(frozen=True)
class Arc:
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
class Table:
    """Arcs of a loop gain, its open-loop poles outside the circle, and the grid with values."""

    arcs: tuple[Arc, ...]
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


def grid(poles: np.ndarray) -> np.ndarray:
    """Return angles from 0 to pi that are dense around every pole, shape (points,)."""
    poles = poles[np.abs(poles) > 1e-6]
    s = np.log(poles)
    centre, width = np.abs(s.imag), np.maximum(np.abs(s.real), 1e-13)
    near = np.tan(np.linspace(-1.5, 1.5, _POINTS))
    order = np.sort(np.concatenate([[0.0], centre, [math.pi]]))
    gap = np.diff(order)
    share = np.geomspace(1e-4, 0.5, _GAP_POINTS)
    parts = [
        (centre[:, None] + width[:, None] * near).ravel(),
        (order[:-1, None] + gap[:, None] * share).ravel(),
        (order[1:, None] - gap[:, None] * share).ravel(),
        np.linspace(0.0, math.pi, 400),
    ]
    theta = np.unique(np.concatenate(parts))
    theta = theta[(theta > 0.0) & (theta < math.pi)]
    return np.concatenate([[0.0], theta, [math.pi]])


def make_table(gain: Callable[[np.ndarray], np.ndarray], poles: np.ndarray) -> Table:
    """Return the table of a loop gain without latency.

    Args:
        gain: L by complex Z, any shape.
        poles: of plant and law, one of each pair, shape (n,).
    """
    theta = grid(poles)

    def log_of(angles: np.ndarray) -> np.ndarray:
        z = np.exp(1j * angles)
        value = gain(z)
        real = (angles == 0.0) | (angles == math.pi)
        value = np.where(real, value.real, value)
        return np.log(np.where(value == 0.0, 1e-300, value).astype(complex))

    value = log_of(theta)
    open_ = np.ones(len(theta) - 1, bool)
    for _ in range(_MOST_ROUNDS):
        which = np.flatnonzero(open_)
        if not len(which):
            break
        middle = 0.5 * (theta[which] + theta[which + 1])
        inside = (middle > theta[which]) & (middle < theta[which + 1])
        which, middle = which[inside], middle[inside]
        found = log_of(middle)
        first, second = found - value[which], value[which + 1] - found
        turn_1, turn_2 = _wrapped(first.imag), _wrapped(second.imag)
        error = np.hypot(first.real - second.real, turn_1 - turn_2)
        close = np.minimum(np.abs(found.real), np.abs(value[which].real)) < 1.0
        bad = error > np.where(close, _NEAR, _ELSEWHERE)
        bad |= (np.abs(turn_1) > 1.0) | (np.abs(turn_2) > 1.0)
        flags = np.zeros(len(theta) - 1, bool)
        flags[which[bad]] = True
        at = which + 1
        theta, value = np.insert(theta, at, middle), np.insert(value, at, found)
        left = np.insert(flags, at, flags[which])  # both halves of a bad interval stay open
        open_ = left
    size = value.real
    phase = np.unwrap(value.imag)
    above = size > 0.0
    change = np.flatnonzero(above[1:] != above[:-1])
    low, high = theta[change].copy(), theta[change + 1].copy()
    for _ in range(_HALVINGS if len(change) else 0):
        middle = 0.5 * (low + high)
        same = (log_of(middle).real > 0.0) == above[change]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edge = 0.5 * (low + high)
    turn = log_of(edge).imag if len(change) else np.empty(0)
    edge_phase = phase[change] + _wrapped(turn - phase[change])
    arcs = []
    start, start_phase = (0.0, float(phase[0])) if above[0] else (math.nan, math.nan)
    for i, j in enumerate(change):
        if above[j]:
            arcs.append(Arc(start, float(edge[i]), start_phase, float(edge_phase[i])))
        else:
            start, start_phase = float(edge[i]), float(edge_phase[i])
    if above[-1]:
        arcs.append(Arc(start, math.pi, start_phase, float(phase[-1])))
    outside = poles[np.abs(poles) > 1.0]
    count = int(sum(1 if abs(p.imag) < 1e-15 else 2 for p in outside))
    return Table(tuple(arcs), count, theta, size + 1j * phase)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return np.asarray(np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi)
