"""How fast the loop of a setup grows in flight: its closed-loop poles outside the unit circle."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
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
from hertzloop.studies.margin.poles import MOST_STATES, closed_loop_poles, states_of

_REAL = 1e-12  # rad: the angle of a real pole is this small by rounding
_ON_CIRCLE = 1e-13  # distance from the unit circle that is rounding


@dataclass(frozen=True)
class Growth:
    """How the loop of a setup grows in flight at the latency of its scene.

    Attributes:
        unstable_poles: closed-loop poles outside the unit circle; None if two counts disagree.
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
    return replace(found, e_folds=found.per_s * setup.run.duration_s)


def stable_in_flight(setup: Setup) -> bool | None:
    """Return whether the loop is stable in flight at the latency of the scene; None for a setup
    without a linear loop, or for which none can be formed.

    It costs one table at any sampling interval, but is not checked by a second method: see
    `growth_of`.
    """
    if why_no_loop(setup):
        return None
    setup, every = loop_setup(setup), setup.sensor.every_steps
    delay, rest = divmod(1 + setup.signal_path.dead_steps + setup.signal_path.latency_steps, every)
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
    latency = setup.signal_path.latency_steps
    count = int(loops.unstable(np.array([latency]))[0])
    loop, delay = loops.at(latency)
    too_many = states_of(loop.plant, loop.law, delay) > MOST_STATES
    poles = None if too_many else outside_poles(loop, delay, count)
    if poles is None and not too_many:
        return Growth(None, None, None, None)
    if not count:
        return Growth(0, 0.0, None, 0.0)
    if poles is None:
        return Growth(count, None, None, None)
    sample_s = setup.sensor.every_steps * setup.run.step_s
    return Growth(count, growth_per_s(poles, sample_s), fastest_hz(poles, sample_s), None)


def outside_poles(loop: Loop, delay: int, count: int) -> np.ndarray | None:
    """Return the closed-loop poles outside the unit circle; None if they are too many to compute,
    or if their number is not `count`, so that two independent methods disagree."""
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
