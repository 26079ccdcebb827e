"""Thresholds of the slope, shifted so that a law with a known latency acts in time."""

import math
from functools import lru_cache
from typing import Any

from scipy.integrate import solve_ivp


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

    By a Hertz contact of `stiffness` (N/m^1.5) between sphere and infinite plate, xi'' = F/m +
    F'/Z (Zener 1941). -inf where that is before the contact's start, so that the first sample
    in contact crosses it; the threshold itself where the contact never reaches it.
    """

    def slope(t: float, y: Any) -> list[float]:
        p = max(-float(y[0]), 0.0)
        force, rate = stiffness * p**1.5, -1.5 * stiffness * math.sqrt(p) * float(y[1])
        return [float(y[1]), force / mass_kg + rate / impedance_n_s_m]

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
        slope, (0.0, longest), [0.0, -impact_speed_m_s], events=(reached, over),
        rtol=1e-8, atol=1e-14, dense_output=True,
    )  # fmt: skip
    if not len(solved.t_events[0]):
        return v_thr_m_s
    at = float(solved.t_events[0][0]) - earlier_s
    return float(solved.sol(at)[1]) if at > 0.0 else -math.inf
