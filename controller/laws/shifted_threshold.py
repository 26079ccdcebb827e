"""The published law with its threshold shifted, so that with a known latency it acts in time."""

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from hertzloop.controller.law import ForceBound, LawContext
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    Parameters,
    State,
    command,
    command_ahead,
    known_ahead,
    latches,
    not_linear,
    trigger_level,
    tune,
)

_PARTS = 32  # steps in the shortest time in which the state changes
_HALVINGS = 60
_LONGEST = 10.0  # contact times on a rigid plate


class _Impact(NamedTuple):
    """Sphere on an infinite plate from the first touch on: root of the penetration (m^0.5), speed
    of the sphere (m/s, down) and time (s)."""

    root: float
    speed: float
    time_s: float


def prepare(keys, about: LawContext) -> slope_threshold.Constants:
    """Constants of the published law with another threshold. Raises LawError as `predicted`."""
    v_thr = shifted_threshold_m_s(
        about.stiffness,
        about.sphere_mass_kg,
        about.impedance_n_s_m,
        about.impact_speed_m_s,
        keys.v_thr_m_s,
        about.loop_delay_s,
    )
    return slope_threshold.prepare(keys, about)._replace(v_thr_m_s=v_thr)


def force_bound(keys) -> ForceBound:
    """A share of the contact force."""
    return ForceBound(share=abs(keys.kappa))


@lru_cache(maxsize=1024)
def shifted_threshold_m_s(
    stiffness: float,
    mass_kg: float,
    impedance_n_s_m: float,
    impact_speed_m_s: float,
    v_thr_m_s: float,
    earlier_s: float,
) -> float:
    """Slope that a contact has `earlier_s` before it reaches `v_thr_m_s`; m/s.

    By the local model of the law that predicts, with a contact of `stiffness` (N/m^1.5). -inf
    where that is before the contact's start, so that the first sample in contact crosses it; the
    threshold itself where the contact never reaches it.
    """
    if v_thr_m_s <= -impact_speed_m_s:
        return v_thr_m_s
    by_mass, by_plate = stiffness / mass_kg, stiffness / impedance_n_s_m

    def slope(at: _Impact) -> float:
        return by_plate * at.root * at.root * at.root - at.speed

    def after(at: _Impact, length: float) -> _Impact:
        return _advanced(at, length, by_mass, by_plate)

    lasts_s = 3.214 * (mass_kg / stiffness) ** 0.4 * impact_speed_m_s**-0.2
    deepest_m = min((impact_speed_m_s / by_plate) ** (2.0 / 3.0), lasts_s * impact_speed_m_s)
    rate = math.sqrt(impact_speed_m_s / lasts_s) + by_plate * deepest_m
    # A power of two, so that the last digits of these powers do not matter.
    length = 2.0 ** -round(math.log2(_PARTS * rate))
    path = [_Impact(0.0, impact_speed_m_s, 0.0)]
    while slope(path[-1]) < v_thr_m_s:
        path.append(after(path[-1], length))
        if path[-1].root <= 0.0 or path[-1].time_s > _LONGEST * lasts_s:
            return v_thr_m_s
    last = path[-2]
    reached = after(last, _zero_of(lambda part: slope(after(last, part)) - v_thr_m_s, length))
    time_s = reached.time_s - earlier_s
    if time_s <= 0.0:
        return -math.inf
    before = path[bisect_right(path, time_s, key=lambda at: at.time_s) - 1]
    return slope(after(before, _zero_of(lambda part: after(before, part).time_s - time_s, length)))


def _zero_of(rising: Callable[[float], float], length: float) -> float:
    """Zero of a rising function between 0 and `length`, by bisection."""
    low, high = 0.0, length
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rising(middle) < 0.0 else (low, middle)
    return low


def _advanced(at: _Impact, h: float, by_mass: float, by_plate: float) -> _Impact:
    """The impact after a step by the classical Runge-Kutta method.

    With x = sqrt(p) and dt = x ds, x' = (v - x^3 K/Z)/2 and v' = -x^4 K/m: smooth at both ends of
    the contact. No powers of the C library: their last digits depend on the processor.
    """

    def rates(x: float, v: float) -> tuple[float, float, float]:
        cube = x * x * x
        return 0.5 * (v - by_plate * cube), -by_mass * x * cube, x

    x, v, t = at
    x1, v1, t1 = rates(x, v)
    x2, v2, t2 = rates(x + 0.5 * h * x1, v + 0.5 * h * v1)
    x3, v3, t3 = rates(x + 0.5 * h * x2, v + 0.5 * h * v2)
    x4, v4, t4 = rates(x + h * x3, v + h * v3)
    return _Impact(
        x + h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4),
        v + h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4),
        t + h / 6.0 * (t1 + 2.0 * t2 + 2.0 * t3 + t4),
    )
