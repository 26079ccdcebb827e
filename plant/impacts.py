"""Impacts of a run, from its rows of truth: the figures that `run` and `inspect` print."""

from dataclasses import dataclass

import numpy as np

from plant.contact import GRAVITY_M_S2


@dataclass(frozen=True)
class Impact:
    """One contact. Times in s since the start of the run, found between two steps by linear
    interpolation of the gap; speeds of the sphere, the impact speed positive downwards, the
    rebound speed positive upwards; `plate_energy_j`: work of contact and actuator force on
    the plate from this contact's start to the next one's (or the end of the run).
    """

    start_s: float
    duration_s: float
    impact_speed_m_s: float
    rebound_speed_m_s: float
    peak_force_n: float
    plate_energy_j: float


def sphere_speed_m_s(
    xi_s: np.ndarray,
    f_c: np.ndarray,
    mass_kg: float,
    step_s: float,
    f_c1: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Speed of the sphere at every step but the last, up positive, shape (steps - 1,).

    Exact for a force F + F_1 (2 t/h - 1): v = (x1 - x0)/h - ((F - F_1/3)/m - g) h/2.
    """
    held = (f_c - np.asarray(f_c1) / 3.0)[:-1] / mass_kg - GRAVITY_M_S2
    return np.diff(xi_s) / step_s - 0.5 * held * step_s


def _crossing(xi: np.ndarray, before: int) -> float:
    """Position of xi = 0 between `before` and the next step, in steps."""
    a, b = float(xi[before]), float(xi[before + 1])
    return before + (a / (a - b) if a != b else 0.0)


def impacts(
    xi: np.ndarray,
    xi_s: np.ndarray,
    xi_p: np.ndarray,
    f_c: np.ndarray,
    f_a: np.ndarray,
    xi_a: np.ndarray | None,
    mass_kg: float,
    step_s: float,
    f_c1: np.ndarray | None = None,
    v_p: np.ndarray | None = None,
    impedance_n_s_m: float | None = None,
) -> list[Impact]:
    """All impacts of a run from its rows of truth (arrays of shape (steps,)).

    `xi_a` is the displacement at the actuator, None where that is the contact point. Where the
    contact force changes over a step, by `f_c1`, the plate velocity `v_p` is needed for the
    work of that part, F_1 h (v_1 - v_0)/6 by Hermite's mean of the displacement; on an infinite
    plate of `impedance_n_s_m`, v = F/Z, it is F_1^2 h/(3 Z). A contact
    that the run's end cuts off counts with what there is of it, if there is any.
    """
    if len(xi) < 3:
        return []
    touching = np.diff((f_c != 0.0).astype(np.int8), prepend=np.int8(0))
    starts, ends = np.flatnonzero(touching == 1), np.flatnonzero(touching == -1)
    slope = np.zeros(len(xi)) if f_c1 is None else f_c1
    speed = sphere_speed_m_s(xi_s, f_c, mass_kg, step_s, slope)
    at_actuator = xi_p if xi_a is None else xi_a
    work = np.append(-f_c[:-1] * np.diff(xi_p) + f_a[:-1] * np.diff(at_actuator), 0.0)
    if impedance_n_s_m is not None:
        work[:-1] += slope[:-1] ** 2 * step_s / (3.0 * impedance_n_s_m)
    elif v_p is not None:
        work[:-1] -= slope[:-1] * np.diff(v_p) * step_s / 6.0
    found = []
    last = len(xi) - 1
    for i, start in enumerate(starts.tolist()):
        end = int(ends[i]) if i < len(ends) else last
        until = int(starts[i + 1]) if i + 1 < len(starts) else len(xi)
        began = _crossing(xi, start) if xi[start] > 0.0 and start < last else float(start)
        cut_off = i >= len(ends) or xi[end] <= 0.0
        ended = float(end) if cut_off else _crossing(xi, end - 1)
        if ended <= began:
            continue  # began in the very last step of the run
        found.append(
            Impact(
                start_s=began * step_s,
                duration_s=(ended - began) * step_s,
                impact_speed_m_s=-float(speed[min(start, last - 1)]),
                rebound_speed_m_s=float(speed[min(end, last - 1)]),
                peak_force_n=float(f_c[start : end + 1].max()),
                plate_energy_j=float(work[start:until].sum()),
            )
        )
    return found
