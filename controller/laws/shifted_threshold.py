"""The published law with its threshold shifted, so that with a known latency it acts in time."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

from hertzloop.controller.law import ForceBound, LawContext
from hertzloop.controller.laws import slope_threshold
from hertzloop.controller.laws._local_model import acceleration
from hertzloop.controller.laws.slope_threshold import (  # noqa: F401
    Parameters,
    State,
    command,
    command_ahead,
    known_ahead,
    latches,
    not_linear,
    quiet_level,
    tune,
)


class _Impact(NamedTuple):
    stiffness: float
    mass_kg: float
    impedance_n_s_m: float
    contact_level: float = 0.0


def prepare(keys, about: LawContext) -> slope_threshold.Constants:
    """Constants of the published law with another threshold. Raises LawError as `predicted`."""
    v_thr = shifted_threshold_m_s(
        about.stiffness,
        about.sphere_mass_kg,
        about.impedance_n_s_m,
        about.impact_speed_m_s,
        keys.v_thr_m_s,
        about.horizon_s,
    )
    return slope_threshold.prepare(keys, about)._replace(v_thr_m_s=v_thr)


def reach(keys) -> ForceBound:
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
    from scipy.integrate import solve_ivp  # 0.4 s of every start, for this law alone

    impact = _Impact(stiffness, mass_kg, impedance_n_s_m)

    def slope(t: float, y: Any) -> list[float]:
        return [float(y[1]), float(acceleration(impact, float(y[0]), float(y[1])))]

    def reached(t: float, y: Any) -> float:
        return float(y[1]) - v_thr_m_s

    def over(t: float, y: Any) -> float:
        return float(y[0])

    reached.terminal = over.terminal = True  # type: ignore[attr-defined]
    over.direction = 1.0  # type: ignore[attr-defined]
    if v_thr_m_s <= -impact_speed_m_s:
        return v_thr_m_s
    # Ten times the contact time on a rigid plate.
    longest = 32.14 * (mass_kg / stiffness) ** 0.4 * impact_speed_m_s**-0.2
    solved: Any = solve_ivp(
        slope,
        (0.0, longest),
        [0.0, -impact_speed_m_s],
        events=(reached, over),
        rtol=1e-8,
        atol=1e-14,
        dense_output=True,
    )
    if not len(solved.t_events[0]):
        return v_thr_m_s
    at = float(solved.t_events[0][0]) - earlier_s
    return float(solved.sol(at)[1]) if at > 0.0 else -math.inf
