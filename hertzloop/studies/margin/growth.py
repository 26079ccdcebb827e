"""How fast the loop of a setup grows in flight: its closed-loop poles outside the unit circle."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.gain import phase_crossings
from hertzloop.studies.margin.identify import NotLinearError, law_filter
from hertzloop.studies.margin.linear import plant_in_flight
from hertzloop.studies.margin.loop import (
    Loop,
    damped,
    law_digest,
    loop_of,
    loop_setup,
    loops_of,
    why_no_loop,
)
from hertzloop.studies.margin.poles import MOST_STATES, closed_loop_poles

_NEWTON = 60
_REAL = 1e-12  # rad: the angle of a real pole is this small by rounding
_ON_CIRCLE = 1e-13  # distance from the unit circle that is rounding


@dataclass(frozen=True)
class Growth:
    """How the loop of a setup grows in flight at the latency of its scene.

    Attributes:
        unstable_poles: closed-loop poles outside the unit circle; None if two methods disagree.
        per_s: fastest growth, 1/s; 0 if stable, None if undecided.
        frequency_hz: of the fastest growing pole, Hz; None if stable or undecided.
        e_folds: growth times the length of the run; None if undecided.
    """

    unstable_poles: int | None
    per_s: float | None
    frequency_hz: float | None
    e_folds: float | None


def growth_of(setup: Setup) -> Growth | None:
    """Return how the loop grows in flight; None for a setup without a linear loop, or for which
    none can be formed; undecided where the numbers fail. It follows a run or a sweep, and must not
    cost their results.

    Setups that differ in nothing that the loop depends on share one calculation, and those that
    differ in the latency alone share its largest part.
    """
    if why_no_loop(setup):
        return None
    try:
        found = _growth(loop_setup(setup), law_digest(setup))
    except SceneError:
        return None
    except (ArithmeticError, np.linalg.LinAlgError):
        return Growth(None, None, None, None)
    if isinstance(found, NotLinearError):
        return None
    if found.per_s is None:
        return found
    return replace(found, e_folds=found.per_s * setup.duration_s)


def stable_in_flight(setup: Setup) -> bool | None:
    """Return whether the loop is stable in flight at the latency of the scene; None for a setup
    without a linear loop, or for which none can be formed.

    It costs one table at any sampling interval, but is not checked by a second method: see
    `growth_of`.
    """
    if why_no_loop(setup):
        return None
    setup, every = loop_setup(setup), setup.every_steps
    delay, rest = divmod(1 + setup.line.dead_steps + setup.line.latency_steps, every)
    try:
        loop = loop_of(damped(plant_in_flight(setup)), law_filter(setup), every, rest)
    except (NotLinearError, SceneError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return not loop.table.unstable(np.array([delay]))[0]


@lru_cache(maxsize=4096)
def _growth(setup: Setup, digest: str) -> Growth | NotLinearError:
    """Return the growth of a loop, without e-folds, or why it is not linear."""
    loops = loops_of(setup)
    if isinstance(loops, NotLinearError):
        return loops
    latency = setup.line.latency_steps
    count = int(loops.unstable(np.array([latency]))[0])
    loop, delay = loops.at(latency)
    poles = outside_poles(loop, delay, count)
    if poles is None:
        return Growth(None, None, None, None)
    if not count:
        return Growth(0, 0.0, None, 0.0)
    sample_s = setup.every_steps * setup.step_s
    return Growth(count, growth_per_s(poles, sample_s), fastest_hz(poles, sample_s), None)


def outside_poles(loop: Loop, delay: int, count: int) -> np.ndarray | None:
    """Return the closed-loop poles outside the unit circle; None if their number is not `count`,
    so that two independent methods disagree."""
    if 2 * len(loop.plant.poles) + delay > MOST_STATES:
        if not count:
            return np.empty(0, complex)
        poles = unstable_poles(loop, delay)
        if sum(1 if abs(p.imag) < 1e-12 else 2 for p in poles) == count:
            return poles
    found = closed_loop_poles(loop.plant, loop.law, delay)
    if found is None:
        return None
    size = np.abs(found)
    if not np.sum(size > 1.0 + _ON_CIRCLE) <= count <= np.sum(size > 1.0 - _ON_CIRCLE):
        return None
    return found[np.argsort(-size)[:count]]


def growth_per_s(poles: np.ndarray, sample_s: float) -> float:
    """Return the growth of the pole that is farthest outside the unit circle, 1/s."""
    return math.log(float(np.abs(poles).max())) / sample_s


def fastest_hz(poles: np.ndarray, sample_s: float) -> float:
    """Return the frequency of the pole that is farthest outside the unit circle, Hz."""
    fastest = poles[int(np.argmax(np.abs(poles)))]
    angle = abs(float(np.angle(fastest)))
    return 0.0 if angle < _REAL else angle / (2.0 * math.pi * sample_s)


def unstable_poles(loop: Loop, delay: int) -> np.ndarray:
    """Return closed-loop poles outside the unit circle in the upper half plane, by Newton's method
    from every place where L passes the negative axis beyond -1; some may be missed."""
    angle, size = phase_crossings(loop, delay)
    s = 1j * angle[size > 1.0]
    if not len(s):
        return np.empty(0, complex)

    def error(at: np.ndarray) -> np.ndarray:
        return np.log(-loop.gain(np.exp(at)) * np.exp(-delay * at))

    for _ in range(_NEWTON):
        step = 1e-7 * np.maximum(np.abs(error(s)), 1e-3) * 1e-1
        value = error(s)
        slope = (error(s + step) - value) / step
        change = value / slope
        limit = 0.3 * np.maximum(np.abs(s.real), 1e-3)
        change *= np.minimum(1.0, limit / np.maximum(np.abs(change), 1e-300))
        s = s - change
        if np.all(np.abs(change) < 1e-12):
            break
    done = (np.abs(error(s)) < 1e-5) & (s.real > 0.0)
    s = s[done]
    s = np.where(s.imag < 0.0, s.conj(), s)
    kept: list[complex] = []
    for one in s[np.argsort(-s.real)]:
        if all(abs(one - other) > 1e-7 for other in kept):
            kept.append(complex(one))
    return np.exp(np.array(kept, complex))
