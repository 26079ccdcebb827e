"""How fast the loop of a setup grows in flight: its closed-loop poles outside the unit circle."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.identify import NotLinearError
from hertzloop.studies.margin.loop import law_digest, loop_setup, loops_of, why_no_loop
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import Loop

_REAL = 1e-12  # rad: the angle of a real pole is this small by rounding


@dataclass(frozen=True)
class Growth:
    """How the loop of a setup grows in flight at the latency of its scene.

    Attributes:
        unstable_poles: closed-loop poles outside the unit circle; None if the numbers fail.
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
    without a linear loop, or for which none can be formed."""
    if why_no_loop(setup):
        return None
    try:
        loops = loops_of(setup)
        if isinstance(loops, NotLinearError):
            return None
        return not loops.unstable(np.array([setup.signal_path.latency_steps]))[0]
    except (SceneError, ArithmeticError, np.linalg.LinAlgError):
        return None


@lru_cache(maxsize=4096)
def _growth(setup: Setup, digest: str) -> Growth | NotLinearError:
    """Return the growth of a loop, without e-folds, or why it is not linear."""
    loops = loops_of(setup)
    if isinstance(loops, NotLinearError):
        return loops
    latency = setup.signal_path.latency_steps
    count = int(loops.unstable(np.array([latency]))[0])
    if not count:
        return Growth(0, 0.0, None, 0.0)
    fastest = fastest_pole(*loops.at(latency))
    if fastest is None or abs(fastest) <= 1.0:  # too close to the circle to be told
        return Growth(count, None, None, None)
    sample_s = setup.run.step_s * len(loops.every)
    return Growth(count, math.log(abs(fastest)) / sample_s, frequency_hz(fastest, sample_s), None)


def fastest_pole(loop: Loop, delay: int) -> complex | None:
    """Return the closed-loop pole of the largest size; None if they are too many to compute."""
    found = closed_loop_poles(loop.plant, loop.law, delay)
    return None if found is None else complex(found[np.argmax(np.abs(found))])


def frequency_hz(pole: complex, sample_s: float) -> float:
    """Return the frequency of a pole, Hz."""
    angle = abs(float(np.angle(pole)))
    return 0.0 if angle < _REAL else angle / (2.0 * math.pi * sample_s)
