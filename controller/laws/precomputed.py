"""The study's pre-computed forces F_a1 to F_a13, and the early alternative of its appendix A.1.

All but the last follow from the contact force F_c0 of the same impact without control; its
duration T0 is that of F_c0. They are shifted by `delay_us` = (t_a - 1) dt.
"""

import math
from typing import Literal

import numpy as np
from pydantic import Field

from hertzloop.common import elementary_kernels
from hertzloop.common.uncompiled import plain
from hertzloop.controller.law import ForceBound, Gain, LawContext
from hertzloop.controller.laws import profile
from hertzloop.controller.laws.profile import (  # noqa: F401
    State,
    command,
    command_ahead,
    known_ahead,
    trigger_level,
)

CONSTANT, CONTACT_FORCE, SINE, COSINE = "constant", "contact_force", "sine", "cosine"
# F_a3 to F_a5 are F_a2 at another shift or under a sweep of it, and so on.
SHAPES = {
    "F_a1": CONSTANT,
    **{f"F_a{i}": CONTACT_FORCE for i in range(2, 6)},
    **{f"F_a{i}": SINE for i in range(6, 10)},
    **{f"F_a{i}": COSINE for i in range(10, 14)},
}
Name = Literal[
    "F_a1",
    "F_a2",
    "F_a3",
    "F_a4",
    "F_a5",
    "F_a6",
    "F_a7",
    "F_a8",
    "F_a9",
    "F_a10",
    "F_a11",
    "F_a12",
    "F_a13",
    "F_mobility",
]

_exp = plain(elementary_kernels.exp)
_sine_and_cosine = plain(elementary_kernels.sine_and_cosine)
_sine_and_cosine_of_pi = plain(elementary_kernels.sine_and_cosine_of_pi)

open_loop = True


class Parameters(profile.Timing):
    """Scene keys."""

    precomputed: Name = Field("F_a2", description="the study's name of the force")
    kappa: Gain = Field(0.8, description="its factor")


def prepare(keys, about: LawContext) -> profile.Constants:
    """Constants of a profile."""
    if keys.precomputed == "F_mobility":
        force = keys.kappa * mobility_force_n(about)
    else:
        force = shaped(SHAPES[keys.precomputed], keys.kappa, about.uncontrolled_force_n())
    return profile.played(force[:: about.every_steps], keys, about)


def force_bound(keys) -> ForceBound:
    """A share of the contact force."""
    return ForceBound(share=abs(keys.kappa))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return {"kappa": (-1.0, 2.0), "delay_us": (0.0, 50.0)}


def shaped(shape: str, kappa: float, contact_n: np.ndarray) -> np.ndarray:
    """kappa max(F_c0), or kappa F_c0 times 1, sin or cos of 2 pi t/T0; as long as F_c0.

    A constant force lasts as long as F_c0, too: without an end, kappa = 1 and 2 would never
    let the published impact end.
    """
    if shape == CONSTANT:
        return np.full(len(contact_n), kappa * float(contact_n.max()))
    count = len(contact_n)
    turns = np.array([_sine_and_cosine_of_pi(2.0 * i / count) for i in range(count)])
    windows = {CONTACT_FORCE: np.ones(count), SINE: turns[:, 0], COSINE: turns[:, 1]}
    return np.asarray(kappa * contact_n * windows[shape])


def mobility_force_n(about: LawContext) -> np.ndarray:
    """Contact force of a simplified mobility model of the impact; shape (steps,), N.

    Our derivation of the idea of appendix A.1, whose own formula is not at hand: sphere of mass
    m, Hertz contact as a spring s_l of the same contact time on a rigid plate, plate as the
    point impedance Z = 8 sqrt(B' m'') of an infinite one:
    F'' + (s_l/Z) F' + (s_l/m) F = 0, F(0) = 0, F'(0) = s_l v0; until F returns to zero, or,
    overdamped, falls below 1e-3 of its peak.
    """
    m, v, step_s = about.sphere_mass_kg, about.impact_speed_m_s, about.step_s
    turn = math.pi / about.rigid_contact_s
    spring = m * turn * turn
    decay = 0.5 * spring / about.impedance_n_s_m
    squared = spring / m - decay * decay
    root = math.sqrt(abs(squared))
    if squared > 0.0:
        t = np.arange(int(math.pi / root / step_s) + 1) * step_s
        sines = np.array([_sine_and_cosine(angle)[0] for angle in (root * t).tolist()])
        return np.asarray(spring * v / root * _faded(decay, t) * sines)
    slow = decay - root  # of the two decays; the quick one is over long before
    t = np.arange(int(math.log(1e3) / slow / step_s) + 1) * step_s
    if root == 0.0:
        return np.asarray(spring * v * t * _faded(decay, t))
    return np.asarray(spring * v / (2.0 * root) * (_faded(slow, t) - _faded(decay + root, t)))


def _faded(rate: float, t: np.ndarray) -> np.ndarray:
    """exp(-rate t), shape (times,)."""
    return np.array([_exp(x) for x in (-rate * t).tolist()])
