"""Compiled kernels of the modes left out as one damped mode; see `plant.schemes.collocation`.

Displacement at the contact point is Im z, z' = s z + g F with a complex g, F the force up on the
plate. As Im g = Y, the point's velocity follows the force at once by Y F, on top of Im(s z).
A model has a `ResidualMode`, or None: there is none, or it is a spring.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import by_type, no, nothing, yes, zero
from hertzloop.plant.state_kernels import RESIDUAL_IM, RESIDUAL_RE, SILENT_M, TRUNCATED_DISSIPATED


class ResidualMode(NamedTuple):
    """Coefficients of a step. `turn`: e^(s h); `by_0`, `by_1`: change of z by a unit force and a
    unit 2 t/h - 1; `speed`: Im(s z) by z; `mean`: of the displacement by z at the start; `energy`
    (3,) and `lost` (10,): quadratic forms of z, and of z at the end without force, F_0 and F_1."""

    turn_re: float
    turn_im: float
    by_0_re: float
    by_0_im: float
    by_1_re: float
    by_1_im: float
    speed_re: float
    speed_im: float
    mean_re: float
    mean_im: float
    mobility_m_ns: float
    energy: np.ndarray
    lost: np.ndarray


@kernel(inline=True)
def _turned(mode, body):
    a, b = body[RESIDUAL_RE], body[RESIDUAL_IM]
    mean = mode.mean_re * a + mode.mean_im * b
    if abs(a) + abs(b) <= SILENT_M:
        a = 0.0
        b = 0.0
    c = mode.turn_re * a - mode.turn_im * b
    d = mode.turn_re * b + mode.turn_im * a
    body[RESIDUAL_RE] = c
    body[RESIDUAL_IM] = d
    return d, mode.speed_re * c + mode.speed_im * d, mean


@kernel(inline=True)
def _pushed(mode, state, f0, f1):
    body, q = state.body, mode.lost
    a, b = body[RESIDUAL_RE], body[RESIDUAL_IM]
    lost = a * (q[0] * a + q[1] * b + q[2] * f0 + q[3] * f1)
    lost += b * (q[4] * b + q[5] * f0 + q[6] * f1)
    lost += f0 * (q[7] * f0 + q[8] * f1) + q[9] * f1 * f1
    state.balance[TRUNCATED_DISSIPATED] += lost
    body[RESIDUAL_RE] = a + (mode.by_0_re * f0 + mode.by_1_re * f1)
    body[RESIDUAL_IM] = b + (mode.by_0_im * f0 + mode.by_1_im * f1)


@kernel(inline=True)
def _mobility(mode):
    return mode.mobility_m_ns


@kernel(inline=True)
def _energy(mode, body):
    a, b = body[RESIDUAL_RE], body[RESIDUAL_IM]
    return mode.energy[0] * a * a + mode.energy[1] * a * b + mode.energy[2] * b * b


@kernel(inline=True)
def _none(mode, body):
    return 0.0, 0.0, 0.0


# Whether there is one, known when a caller is compiled.
there = by_type({type(None): no, ResidualMode: yes})
# Turn it by a step: displacement at its end (m), velocity Im(s z) there, mean displacement.
turned = by_type({type(None): _none, ResidualMode: _turned})
# Let a force F_0 + F_1 (2 t/h - 1) of the step act on it (state), and book what it loses.
pushed = by_type({type(None): nothing, ResidualMode: _pushed})
# Velocity that follows a force at once, m/(N s).
mobility = by_type({type(None): zero, ResidualMode: _mobility})
# Energy in it, J, by the state's body.
energy = by_type({type(None): zero, ResidualMode: _energy})
