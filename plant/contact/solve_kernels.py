"""Compiled kernels of the contact in a step of the default scheme `modal`: all that is scalar.

Given gap, velocity and mean of the gap as they would be without contact force, and what a unit
F_0 and F_1 change of them (`gains`), find the contact force F_0 + F_1 (2 t/h - 1) of the step.
See `plant.schemes.collocation_kernels` for the modes and the idea.

Products and sums may be contracted to multiply-adds: what is solved here is one long chain of
operations, each waiting for the last, and a quarter of its time goes with them.
"""

import math

import numpy as np

from jit import kernel
from plant.contact import hertz_kernels as hertz
from plant.contact import path_kernels as path
from plant.schemes import tail_kernels

# Indices into CollocationModel.gains: gap at the end, its velocity, its mean, by F_0 and F_1;
# then the plate's own displacement and velocity (up per force up on it).
# CA, VA, MA: the same by F_a; AC0, AC1, AA: displacement at the actuator; LOSS: energy lost.
X0, X1, V0, V1, M0, M1, PX0, PX1, PV0, PV1, PM0, PM1, CA, VA, MA, AC0, AC1, AA = range(18)
LOSS_00, LOSS_01, LOSS_11, LOSS_0A, LOSS_1A, LOSS_AA = range(18, 24)
# SWING: change of `swing` (see collocation_kernels) by F_0 and F_1, and what turns its change
# into the mean displacement of a step without force.
SWING0, SWING1, MEAN_BY_SWING = range(24, 27)
# By the slope F_a1 of an actuator's force: CA1 to AA1 as CA to AA; MAC0, MAC1, MAA, MAA1: mean
# displacement at the actuator by F_0, F_1, F_a, F_a1; LOSS_0B: energy lost, by F_0 F_a1 and so on.
CA1, VA1, MA1, AA1, MAC0, MAC1, MAA, MAA1 = range(27, 35)
LOSS_0B, LOSS_1B, LOSS_AB, LOSS_BB = range(35, 39)
# START: velocity of the gap right at the start by F_0 and F_1, where the plate answers at once.
START0, START1 = range(39, 41)
# By node of Gauss's rule: gap by F_0 and F_1 there.
NODE0, NODE1 = 41, 41 + path.NODES
GAINS = 41 + 2 * path.NODES

_NEWTON_MOST = 12
CORRECTIONS = 12
ROUNDING, BALANCED = 2e-16, 1e-13  # of the energies at hand: as good as can be, good enough
HALVINGS = 90
_TIGHT = 1e-7  # of the force; Newton squares what is left
# Of the gap at all nodes; what Newton leaves of the force is 0.4 times its square.
_NEAR = 3e-5
_SLIGHT = 1e-9  # of the gap: a correction that moves it less needs no second one
_SOFT = 0.2  # e of `root_penetration` below which its series and one Halley step give 1e-9


def at_nodes(gains: np.ndarray, step_s: float) -> np.ndarray:
    """Gap at the nodes by F_0 and by F_1 (m/N), shape (2 nodes,): `gains` from NODE0 on."""
    x, d, mean = np.array(path.BY_X1), step_s * np.array(path.BY_D1), np.array(path.BY_MEAN)
    start = step_s * np.array(path.BY_D0)
    return np.concatenate([
        x * gains[X0] + d * gains[V0] + mean * gains[M0] + start * gains[START0],
        x * gains[X1] + d * gains[V1] + mean * gains[M1] + start * gains[START1],
    ])  # fmt: skip


@kernel(inline=True, borrowed=True, fused=True)
def slope_at_start(model, d0, f0, f1):
    """Slope of the gap right at the start of a step (m a step) from that without its force."""
    if tail_kernels.there(model.tail):
        return d0 + model.step_s * (model.gains[START0] * f0 + model.gains[START1] * f1)
    return d0


@kernel(inline=True, borrowed=True, fused=True)
def _project(model, x0, x1, d0, d1, mean):
    """Projection of the law along the quartic: F_0, F_1, what damping takes (J), and the
    derivatives of F_0 and F_1 by x1, d1, the mean and (only with a damped tail) d0."""
    q = mean - 0.5 * (x0 + x1) - (d0 - d1) / 12.0
    start, end = path.touching_part(x0, x1, d0, d1, q)
    sums = path.NOTHING
    if start == end:
        return sums
    h = model.step_s
    for i in range(path.NODES):
        t = start + (end - start) * path.GAUSS_T[i]
        w = (end - start) * path.GAUSS_W[i]
        gap, slope = path.quartic(t, x0, x1, d0, d1, q)
        if gap >= 0.0:
            continue
        force, damping, by_gap, by_rate = hertz.damped_law(model, gap, slope / h)
        sums = path.added(sums, w, t, force, damping, slope, by_gap, by_rate / h)
    return sums


@kernel(borrowed=True, fused=True)
def _chord(model, x0, x1):
    """Discrete gradient between two modal gaps, damping included, and damping's part (N)."""
    if x0 >= 0.0 and x1 >= 0.0:
        return 0.0, 0.0
    a = hertz.root_penetration(model, x0) if x0 < 0.0 else 0.0
    b = hertz.root_penetration(model, x1) if x1 < 0.0 else 0.0
    s, share = model.stiffness, model.flexibility_m_n * model.stiffness
    if (x0 < 0.0) != (x1 < 0.0):
        force = (hertz.elastic(model, x1)[1] - hertz.elastic(model, x0)[1]) / (x0 - x1)
    else:
        five = b**4 + b**3 * a + b * b * a * a + b * a**3 + a**4
        six = five * b + a**5
        way = b + a + share * (b * b + b * a + a * a)
        force = s * (0.4 * five + 0.5 * share * six) / way
    rate = (b * b - a * a) / model.step_s
    damping = (model.viscous_n_s_m + model.hunt_crossley_s_m * force) * rate
    return force + damping, damping


@kernel(borrowed=True, fused=True)
def _solve_chord(model, x0, free_x):
    """Constant force over the step by the discrete gradient, by bisection: always ends."""
    gain = model.gains[X0]
    low = min(0.0, _chord(model, x0, free_x)[0])
    high = max(0.0, _chord(model, x0, free_x)[0])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if middle > _chord(model, x0, free_x + gain * middle)[0]:
            high = middle
        else:
            low = middle
    f0 = 0.5 * (low + high)
    x1 = free_x + gain * f0
    return f0, -_chord(model, x0, x1)[1] * (x1 - x0)


@kernel(inline=True, borrowed=True, fused=True)
def _solve_inside(model, x0, d0, free_x, free_d, free_mean, guess0, guess1):
    """Newton for a step that is in contact all the way, without damping in the contact.

    The quartic is linear in F_0 and F_1, with coefficients at the nodes that do not change.
    Returns F_0, F_1, evaluations (none if the general way has to be taken) and the root of the
    penetration near the end (m^0.5).
    """
    g = model.gains
    s = model.stiffness
    share = model.flexibility_m_n * s
    f0, f1 = guess0, guess1
    # While Newton works on the force the processor finds a root to start from when it is known.
    root = hertz.elastic(model, free_x + g[X0] * f0 + g[X1] * f1)[2]
    for evaluation in range(1, _NEWTON_MOST):
        p0 = p1 = 0.0
        a = d = 1.0
        b = c = 0.0
        highest = max(x0, free_x + g[X0] * f0 + g[X1] * f1)
        lowest = min(x0, free_x + g[X0] * f0 + g[X1] * f1)
        for i in range(path.NODES):
            gap = (
                path.BY_X0[i] * x0 + path.BY_X1[i] * free_x
                + path.BY_D0[i] * d0 + path.BY_D1[i] * free_d
                + path.BY_MEAN[i] * free_mean + (g[NODE0 + i] * f0 + g[NODE1 + i] * f1)
            )  # fmt: skip
            highest = max(highest, gap)
            lowest = min(lowest, gap)
            y = math.sqrt(abs(gap))
            e = share * y
            e2 = e * e
            y *= 1.0 - 0.5 * e + e2 * (0.625 - e + e2 * (1.8046875 - 3.5 * e))
            wrong = y * y * (1.0 + share * y) + gap
            rise = y * (2.0 + 3.0 * share * y)
            part = 1.0 / (rise * rise - wrong * (1.0 + 3.0 * share * y))
            y -= wrong * rise * part  # Halley's rule
            force = s * y * y * y
            slope = -3.0 * s * y * y * rise * part
            w = path.GAUSS_W[i]
            p = path.GAUSS_P[i]
            p0 += w * force
            p1 += w * p * force
            by0 = w * slope * g[NODE0 + i]
            by1 = w * slope * g[NODE1 + i]
            a -= by0
            b -= by1
            c -= p * by0
            d -= p * by1
        det = a * d - b * c
        if not (highest < 0.0 and share * share * -lowest < _SOFT * _SOFT and det > 0.0):
            return guess0, guess1, 0, 0.0
        r0, r1 = (f0 - p0) / det, (f1 - p1) / det
        c0 = d * r0 - b * r1
        c1 = a * r1 - c * r0
        f0 -= c0
        f1 -= c1
        moved = 0.0
        for i in range(path.NODES):
            moved = max(moved, abs(g[NODE0 + i] * c0 + g[NODE1 + i] * c1))
        if moved <= -_NEAR * highest:
            return f0, f1, evaluation, root
    return guess0, guess1, 0, 0.0


@kernel(borrowed=True, fused=True)
def _solve_anywhere(model, x0, d0, free_x, free_d, free_mean, guess0, guess1):
    """Newton for any step: F_0, F_1, what damping takes (J), evaluations, whether it ended."""
    g, h = model.gains, model.step_s
    f0, f1, lost = guess0, guess1, 0.0
    for evaluation in range(1, _NEWTON_MOST + 1):
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        d1 = free_d + h * (g[V0] * f0 + g[V1] * f1)
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        start = slope_at_start(model, d0, f0, f1)
        p0, p1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m, f0_s, f1_s = _project(
            model, x0, x1, start, d1, mean
        )
        a = 1.0 - (f0_x * g[X0] + f0_d * h * g[V0] + f0_m * g[M0])
        b = -(f0_x * g[X1] + f0_d * h * g[V1] + f0_m * g[M1])
        c = -(f1_x * g[X0] + f1_d * h * g[V0] + f1_m * g[M0])
        d = 1.0 - (f1_x * g[X1] + f1_d * h * g[V1] + f1_m * g[M1])
        if tail_kernels.there(model.tail):
            a -= f0_s * h * g[START0]
            b -= f0_s * h * g[START1]
            c -= f1_s * h * g[START0]
            d -= f1_s * h * g[START1]
        det = a * d - b * c
        r0, r1 = f0 - p0, f1 - p1
        if not det > 0.0:
            return f0, f1, lost, evaluation, False
        c0 = (d * r0 - b * r1) / det
        c1 = (a * r1 - c * r0) / det
        f0 -= c0
        f1 -= c1
        if abs(c0) + abs(c1) <= _TIGHT * (abs(f0) + abs(f1)):
            return f0, f1, lost, evaluation, True
    return f0, f1, lost, _NEWTON_MOST, False


@kernel(inline=True, borrowed=True, fused=True)
def solve_contact(model, x0, d0, free_x, free_d, free_mean, before, guess0, guess1):
    """Contact force F_0 + F_1 P of a step from its modal gaps without it.

    x: gap (m) at the start and, free of force, at the end; d: its slope per step (m); mean:
    its mean; `before`: energy in the contact at the start (J). Returns F_0, F_1 (N), what
    damping takes (J), evaluations, and the root of the penetration near the end (m^0.5).

    Newton on the projection; then the smallest change of F_0 and F_1 that makes the work equal
    to what the contact gives and damping takes. Where Newton does not end, as with a step far
    too large, the discrete gradient with a constant force takes over.
    """
    f0, f1, lost, root = guess0, guess1, 0.0, 0.0
    evaluations = 0
    if x0 < 0.0 and model.viscous_n_s_m == 0.0 and model.hunt_crossley_s_m == 0.0:
        f0, f1, evaluations, root = _solve_inside(
            model, x0, d0, free_x, free_d, free_mean, guess0, guess1
        )
    done = evaluations > 0
    if not done:
        f0, f1, lost, evaluations, done = _solve_anywhere(
            model, x0, d0, free_x, free_d, free_mean, guess0, guess1
        )
    if done:
        f0, f1, root, done = _balance(model, x0, free_x, free_mean, f0, f1, lost, before, root)
    if not done:
        f0, lost = _solve_chord(model, x0, free_x)
        f1 = root = 0.0
        evaluations += HALVINGS
    return f0, f1, lost, evaluations, root


@kernel(inline=True, borrowed=True, fused=True)
def _balance(model, x0, free_x, free_mean, f0, f1, lost, before, root):
    """Least change of F_0, F_1 that closes the step's energy, the root of the penetration at
    the end before the last change, and whether it was found.

    `before`: energy in the contact at the start; `root`: near that at the end, or zero. The work
    of F_0 + F_1 P on the gap is F_0 (x1 - x0) + F_1 (x1 + x0 - 2 mean).
    """
    g = model.gains
    last = math.inf
    for _ in range(CORRECTIONS):
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        way, bend = x1 - x0, x1 + x0 - 2.0 * mean
        force, after, root = hertz.elastic_near(model, x1, root)
        wrong = f0 * way + f1 * bend + (after - before) + lost
        size = abs(f0 * way) + abs(f1 * bend) + after + before
        if abs(wrong) <= ROUNDING * size or abs(wrong) >= last:
            return f0, f1, root, abs(wrong) <= BALANCED * size
        last = abs(wrong)
        by0 = way + f0 * g[X0] + f1 * (g[X0] - 2.0 * g[M0]) - force * g[X0]
        by1 = bend + f0 * g[X1] + f1 * (g[X1] - 2.0 * g[M1]) - force * g[X1]
        norm = by0 * by0 + by1 * by1
        if norm == 0.0:
            return f0, f1, root, wrong == 0.0
        c0, c1 = wrong / norm * by0, wrong / norm * by1
        f0 -= c0
        f1 -= c1
        # The energy is nearly quadratic in the change: what it leaves is below rounding.
        if abs(g[X0] * c0) + abs(g[X1] * c1) <= -_SLIGHT * max(x0, x1):
            return f0, f1, root, True
    return f0, f1, root, False
