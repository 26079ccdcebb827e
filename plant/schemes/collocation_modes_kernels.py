"""Compiled passes of the default scheme `modal` over all modes, and the table that they read.

See `plant.schemes.collocation_kernels` for the scheme. Nothing here allocates: arrays are
`borrowed`.
"""

import numpy as np
from numba import types
from numba.extending import overload

from jit import kernel
from jit.by_type import apart

# Columns of CollocationModel.table. ROT: e^(s h); C0, C1: change of z by a unit constant force
# and a unit P(t) at the contact; A: by a constant force at the actuator; OUT, B_A: displacement
# at contact and actuator by Im z; B_C: velocity at the contact by z; MEAN: mean displacement
# over the step from z at its end without force.
ROT_RE, ROT_IM, OUT, C0_RE, C0_IM, C1_RE, C1_IM = range(7)
MEAN_RE, MEAN_IM, A_RE, A_IM, B_C, B_A, THETA, ENERGY = range(7, 15)
# Energy lost in a step: a quadratic form of z at its end without forces and F_0, F_1, F_a; the
# terms without z are summed over all modes, in `gains`.
LOSS_RR, LOSS_RI, LOSS_II, LOSS_R0, LOSS_I0, LOSS_R1, LOSS_I1, LOSS_RA, LOSS_IA = range(15, 24)
# The same by the slope F_a1 of a separate actuator's force, and the mean displacement there.
A1_RE, A1_IM, LOSS_RB, LOSS_IB, MEAN_A_RE, MEAN_A_IM = range(24, 30)
COLUMNS = 30


def of_mode(rho, i):
    """rho of mode `i`, whether it is one for all modes or each has its own. Which of the two is
    settled when a pass is compiled: one for all costs nothing."""
    return rho[i] if isinstance(rho, np.ndarray) else rho


@overload(of_mode, inline="always", jit_options={"_nrt": False})
def _compiled_of_mode(rho, i):
    if isinstance(rho, types.Array):
        return lambda rho, i: rho[i]
    return lambda rho, i: rho


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def drift(n, z, table, rho):
    """One step without force of the first `n` modes: displacement and velocity at the point."""
    x = 0.0
    v = 0.0
    for i in range(n):
        c = table[ROT_RE, i] * z[0, i] - table[ROT_IM, i] * z[1, i]
        d = table[ROT_RE, i] * z[1, i] + table[ROT_IM, i] * z[0, i]
        z[0, i] = c
        z[1, i] = d
        x += table[OUT, i] * d
        v += c - of_mode(rho, i) * d
    return x, v


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def mean_of_drift(slow, n, z, table, rho):
    """Mean displacement over the step that `drift` has just made, and `swing` at its end."""
    mean = 0.0
    swing = 0.0
    for i in range(n):
        mean += table[MEAN_RE, i] * z[1, i] + table[MEAN_IM, i] * z[0, i]
    for i in range(np.uint64(slow), np.uint64(n)):  # unsigned: no negative index to look for
        swing += table[OUT, i] * (table[OUT, i] * (z[0, i] + of_mode(rho, 0) * z[1, i]))
    return mean, swing


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def propagate_slow(slow, z, table, rho, f0, f1):
    """Fold f0 + f1 P into the first `slow` modes, propagate one step; displacement, velocity, mean
    displacement at the point.

    These modes turn so little in a step that a difference of `swing` would be all rounding.
    """
    x = 0.0
    v = 0.0
    mean = 0.0
    for i in range(slow):
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        v += c - of_mode(rho, i) * d
        x += table[OUT, i] * d
        mean += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
    return x, v, mean


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def propagate_same_point(slow, n, z, table, rho, f0, f1):
    """The same for the other awake modes; displacement, velocity, swing at the point.

    `swing` is the sum of (Re z + rho Im z)/Theta^2, which falls by (1 + rho^2) times the time
    integral of the displacement while no force acts. Only for modes of one rho: where each has its
    own, all count as slow.
    """
    x = 0.0
    v = 0.0
    w = 0.0
    swing = 0.0
    for i in range(np.uint64(slow), np.uint64(n)):  # unsigned: no negative index to look for
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        v += c
        w += d
        out = table[OUT, i]
        x += out * d
        swing += out * (out * (c + of_mode(rho, 0) * d))
    return x, v - of_mode(rho, 0) * w, swing


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def propagate_two_points(n, z, table, rho, f0, f1, f_a):
    """The same with the actuator elsewhere: displacement, velocity, mean displacement over the
    step at the contact, displacement at the actuator."""
    x = 0.0
    v = 0.0
    m = 0.0
    y = 0.0
    for i in range(n):
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1 + table[A_RE, i] * f_a
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1 + table[A_IM, i] * f_a
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        x += table[OUT, i] * d
        v += table[B_C, i] * (c - of_mode(rho, i) * d)
        m += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
        y += table[B_A, i] * d
    return x, v, m, y


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def dissipated_with_modes(n, z, table, f0, f1):
    """The terms of a step's loss that depend on z and the force at the contact, J."""
    lost = 0.0
    for i in range(n):
        zr, zi = z[0, i], z[1, i]
        by_r = table[LOSS_R0, i] * f0 + table[LOSS_R1, i] * f1
        by_i = table[LOSS_I0, i] * f0 + table[LOSS_I1, i] * f1
        lost += zr * (table[LOSS_RR, i] * zr + table[LOSS_RI, i] * zi + by_r)
        lost += zi * (table[LOSS_II, i] * zi + by_i)
    return lost


@apart
@kernel(borrowed=True, fused=True, reordered=True)
def weighted(n, z, real, imaginary):
    """Sum of z by two columns of the table."""
    total = 0.0
    for i in range(n):
        total += real[i] * z[0, i] + imaginary[i] * z[1, i]
    return total


@apart
@kernel(borrowed=True)
def fold_slope(n, z, table, f_a1):
    """Fold the slope of a separate actuator's force into the first `n` modes."""
    for i in range(n):
        z[0, i] += table[A1_RE, i] * f_a1
        z[1, i] += table[A1_IM, i] * f_a1
