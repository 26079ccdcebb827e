"""Exponential collocation at Gauss nodes on the modal equations of an uncontrolled, undamped
impact, graded towards the ends of contact.

The contact force over a step is the polynomial through its values at s Gauss nodes; the modes
answer to it exactly. After the touch F ~ t^1.5, and before the end likewise, so that equal steps
have order 2.5 whatever s. Steps are therefore halved, from a bank of tables for h, h/2, h/4 ...:
until the one with the touch or the end in it is the shortest, and within a contact to at most
h (tau/T)^beta, where tau = p/|p'| is about the time to or from the end of contact.

z = q'/w + i q, the weight at the contact point included. Nodes count from 0, the end of the step is
node s.
"""

import math

import numpy as np

from benchmarks.integrator_kernels import GRAVITY
from hertzloop.common.jit import kernel

_NEWTON_MOST = 50
_BETA = 2.0 / 3.0


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _ahead(z, turn):
    """Displacement at the point after the free turn `turn`, (2, modes)."""
    x = 0.0
    for i in range(z.shape[1]):
        x += turn[0, i] * z[1, i] + turn[1, i] * z[0, i]
    return x


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _advance(z, turn):
    for i in range(z.shape[1]):
        c = turn[0, i] * z[0, i] - turn[1, i] * z[1, i]
        z[1, i] = turn[0, i] * z[1, i] + turn[1, i] * z[0, i]
        z[0, i] = c


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _push(z, change, force):
    for i in range(z.shape[1]):
        z[0, i] -= change[0, i] * force
        z[1, i] -= change[1, i] * force


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _speed(z, omega):
    v = 0.0
    for i in range(z.shape[1]):
        v += omega[i] * z[0, i]
    return v


@kernel(allocates=True)
def _meet_of_stages(free, gain, stiffness, force, gap, work):
    """Forces (s,) at the nodes, F_i = s max(-gap_i, 0)^1.5, gap = free + gain F, by Newton; `gap`
    (s + 1,) out. `work`: (s, s + 1)."""
    s = force.size
    for _ in range(_NEWTON_MOST):
        for i in range(s + 1):
            gap[i] = free[i]
            for j in range(s):
                gap[i] += gain[i, j] * force[j]
        for i in range(s):
            root = math.sqrt(max(-gap[i], 0.0))
            for j in range(s):
                work[i, j] = 1.5 * stiffness * root * gain[i, j]
            work[i, i] += 1.0
            work[i, s] = stiffness * root**3 - force[i]
        for c in range(s):  # Gauss; the diagonal leads
            for i in range(c + 1, s):
                part = work[i, c] / work[c, c]
                for j in range(c, s + 1):
                    work[i, j] -= part * work[c, j]
        change, size = 0.0, 0.0
        for i in range(s - 1, -1, -1):
            for j in range(i + 1, s):
                work[i, s] -= work[i, j] * work[j, s]
            work[i, s] /= work[i, i]
            force[i] += work[i, s]
            change = max(change, abs(work[i, s]))
            size = max(size, abs(force[i]))
        if change <= 1e-14 * size:
            break
    for i in range(s + 1):
        gap[i] = free[i]
        for j in range(s):
            gap[i] += gain[i, j] * force[j]


@kernel(allocates=True)
def collocation(
    z, body, omega, times, turns, changes, gains, speed_gains, stiffness, scale_s, every, gaps
):
    """Run gaps.size times `every` steps; returns the number of sub-steps.

    body: sphere displacement, velocity; gap and its velocity. For each level l of halving: times
    (levels, s + 1), turns (levels, s + 1, 2, modes), changes (levels, s, 2, modes) of z over a
    step by unit force at a node, gains (levels, s + 1, s) of the gap, speed_gains
    (levels, s) of the sphere's velocity. `scale_s`: T.
    """
    levels, s = gains.shape[0], gains.shape[2]
    force, gap, free = np.zeros(s), np.zeros(s + 1), np.zeros(s + 1)
    work = np.zeros((s, s + 1))
    units = 1 << (levels - 1)  # of the shortest sub-step in a step
    h = times[0, s]
    count = 0
    for k in range(every * gaps.size):
        at = 0
        while at < units:
            level = 0
            while at % (units >> level) != 0:  # sub-steps lie on the grid of their length
                level += 1
            below = body[2] < 0.0 or (body[2] == 0.0 and body[3] < 0.0)
            if below and body[2] == 0.0:
                level = levels - 1
            elif below:
                tau = -body[2] / max(abs(body[3]), 1e-300)
                longest = h * min(1.0, (tau / scale_s) ** _BETA)
                while level < levels - 1 and times[level, s] > longest:
                    level += 1
            while True:
                for i in range(s + 1):
                    t = times[level, i]
                    free[i] = body[0] + t * (body[1] - 0.5 * t * GRAVITY)
                    free[i] -= _ahead(z, turns[level, i])
                    gap[i] = free[i]
                    force[i % s] = 0.0
                if below or gap.min() < 0.0:
                    _meet_of_stages(free, gains[level], stiffness, force, gap, work)
                one_sided = gap.max() <= 0.0 if below else gap.min() >= 0.0
                # The touch and the end belong into the shortest sub-step.
                if one_sided or level == levels - 1:
                    break
                level += 1
            _advance(z, turns[level, s])
            t = times[level, s]
            body[0] += t * (body[1] - 0.5 * t * GRAVITY)
            body[1] -= t * GRAVITY
            for j in range(s):
                if force[j] != 0.0:
                    _push(z, changes[level, j], force[j])
                    body[1] += speed_gains[level, j] * force[j]
            plate = z[1].sum()
            body[0] = gap[s] + plate
            body[2] = gap[s]
            body[3] = body[1] - _speed(z, omega)
            at += units >> level
            count += 1
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = body[2]
    return count
