"""Compiled kernels of the contact: one law, and the contact force of a step.

The law is Hertz's, F = s p^(3/2); where the contact yields, Thornton's (`plant.contact.yielding`):
beyond a penetration the force rises on a line, and from the deepest penetration so far it comes
back on a flatter Hertz curve that ends at a permanent indentation. No yield is a line that begins
at infinity. Damping adds (c + d F) dp/dt.

The contact force of a step is F_0 + F_1 P(t), P = 2 t/h - 1: the projection of the law on linear
functions of the step, along the gap that this force makes. That gap is a quartic through both
ends, the slopes there and the mean, which the modes give exactly. Two equations, solved by
Newton's method; then the least change of F_0 and F_1 that makes the work of the force equal to
what the contact stores and damping takes (Hairer 2010; Brugnano, Iavernaro and Trigiante).

The modes left out of a structure may be a massless spring of flexibility R, their residual, in
series with the contact: then the penetration is p = -gap - R F, with the force F without damping.
The damping force does not bend the residual; its rate is dp/dt = -(d gap/dt)/(1 + R dF/dp).
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

_NODES = 4
_NEWTON_MOST, _CORRECTIONS, _HALVINGS = 16, 12, 90
_TIGHT = 1e-7  # of the force: without damping Newton squares what is left
_ROUNDING, _BALANCED = 2e-16, 1e-13  # of the energies at hand: as good as can be, good enough
_SEARCHED = 16  # parts of a step that are searched for a contact that begins and ends in it
# Gauss-Legendre nodes and weights on (0, 1).
_T = tuple(float(0.5 + 0.5 * x) for x in np.polynomial.legendre.leggauss(_NODES)[0])
_W = tuple(float(0.5 * w) for w in np.polynomial.legendre.leggauss(_NODES)[1])


class ContactModel(NamedTuple):
    """A contact law; `stiffness`: s, N/m^1.5; `yield_m`: penetration at first yield, infinite
    without; `residual_m_n`: flexibility R of the modes left out, m/N."""

    stiffness: float
    yield_m: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    residual_m_n: float


class Unloading(NamedTuple):
    """The Hertz curve down from the deepest penetration so far (m): its stiffness (N/m^1.5), the
    dent where it ends (m), and what yielding took until then (J)."""

    deepest: float
    stiffness: float
    dent: float
    lost: float


class GapPath(NamedTuple):
    """A gap over a step, t from 0 to 1: at both ends (m), its slopes there (m a step), its mean."""

    start: float
    end: float
    slope_0: float
    slope_1: float
    mean: float


@kernel(part=True)
def yield_line(contact, p):
    """Force (N) of a contact that yields at a penetration beyond first yield, the rise of its line
    (N/m), and the work done until then (J)."""
    root = math.sqrt(contact.yield_m)
    force = contact.stiffness * contact.yield_m * root
    rise = 1.5 * contact.stiffness * root
    way = p - contact.yield_m
    return (
        force + rise * way,
        rise,
        0.4 * force * contact.yield_m + way * (force + 0.5 * rise * way),
    )


@kernel(inline=True)
def unloading(contact, deepest):
    """The curve on which the contact comes back from a deepest penetration, m."""
    if deepest <= contact.yield_m:
        return Unloading(deepest, contact.stiffness, 0.0, 0.0)
    force, _, work = yield_line(contact, deepest)
    back = force / (contact.stiffness * math.sqrt(deepest))
    stiffness = force / (back * math.sqrt(back))
    return Unloading(deepest, stiffness, deepest - back, work - 0.4 * force * back)


@kernel(inline=True)
def contact_law(contact, p, curve):
    """Force without damping (N), its slope (N/m), and the work done on the contact (J) at a
    penetration p, with the curve from the deepest one before it; what yielding took is part of the
    work."""
    if p > curve.deepest and p > contact.yield_m:
        return yield_line(contact, p)
    above = p - curve.dent
    if above <= 0.0:
        return 0.0, 0.0, curve.lost
    root = math.sqrt(above)
    force = curve.stiffness * above * root
    return force, 1.5 * curve.stiffness * root, curve.lost + 0.4 * force * above


@kernel(inline=True)
def in_series(contact, gap, curve, guess):
    """The law and the residual at a modal gap, from a force nearby (N): force F (N), dF/dp (N/m),
    work done on both (J), penetration p (m). Newton's method in a bracket."""
    residual = contact.residual_m_n
    p = -gap - residual * guess
    force, slope, work = contact_law(contact, p, curve)
    low, high = -math.inf, math.inf
    done = False
    for _ in range(_HALVINGS):
        wrong = p + residual * force + gap
        if done or wrong == 0.0:
            break
        if wrong < 0.0:
            low = p
        else:
            high = p
        change = wrong / (1.0 + residual * slope)
        done = abs(change) <= 1e-9 * abs(p)
        # The slope jumps at the deepest penetration so far, where Newton may go to and fro; both
        # ends are known by then.
        if not (done or low < p - change < high):
            change = p - 0.5 * (low + high)
        p -= change
        force, slope, work = contact_law(contact, p, curve)
    return force, slope, work + 0.5 * residual * force * force, p


@kernel(inline=True)
def quartic(path, t):
    """Gap (m) at t from 0 to 1, and its slope (m a step)."""
    u = 1.0 - t
    bulge = path.mean - 0.5 * (path.start + path.end) - (path.slope_0 - path.slope_1) / 12.0
    gap = (
        (1.0 + 2.0 * t) * u * u * path.start
        + t * t * (3.0 - 2.0 * t) * path.end
        + t * u * u * path.slope_0
        - t * t * u * path.slope_1
        + 30.0 * t * t * u * u * bulge
    )
    slope = (
        6.0 * t * u * (path.end - path.start)
        + u * (1.0 - 3.0 * t) * path.slope_0
        + t * (3.0 * t - 2.0) * path.slope_1
        + 60.0 * t * u * (u - t) * bulge
    )
    return gap, slope


@kernel(part=True)
def under(free, by_0, by_1, f0, f1):
    """The gap under a force F_0 + F_1 P, from that without it and what each changes."""
    return GapPath(
        free.start + by_0.start * f0 + by_1.start * f1,
        free.end + by_0.end * f0 + by_1.end * f1,
        free.slope_0 + by_0.slope_0 * f0 + by_1.slope_0 * f1,
        free.slope_1 + by_0.slope_1 * f0 + by_1.slope_1 * f1,
        free.mean + by_0.mean * f0 + by_1.mean * f1,
    )


@kernel
def crossing(path, level, inside, outside):
    """Where the gap passes a level between t = `inside`, where it is below, and t = `outside`."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        if middle == inside or middle == outside:
            break
        if quartic(path, middle)[0] < level:
            inside = middle
        else:
            outside = middle
    return inside


@kernel(copied=True)
def touching_part(path, level):
    """The part (from, to) of the step in which the gap is below a level; from = to if there is
    none."""
    if path.start < level and path.end < level:
        return 0.0, 1.0
    if path.start < level:
        return 0.0, crossing(path, level, 0.0, 1.0)
    if path.end < level:
        return crossing(path, level, 1.0, 0.0), 1.0
    if path.slope_0 < 0.0 < path.slope_1:  # it may dip in and out again
        lowest, at = level, -1.0
        for i in range(1, _SEARCHED):
            gap = quartic(path, i / _SEARCHED)[0]
            if gap < lowest:
                lowest, at = gap, i / _SEARCHED
        if at > 0.0:
            return crossing(path, level, at, 0.0), crossing(path, level, at, 1.0)
    return 0.0, 0.0


@kernel
def lowest(path):
    """The lowest gap of a step, at an end or where it turns."""
    if not path.slope_0 < 0.0 < path.slope_1:
        return min(path.start, path.end)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if quartic(path, middle)[1] < 0.0:
            low = middle
        else:
            high = middle
    return quartic(path, low)[0]


class Projection(NamedTuple):
    """The law along a gap, projected on linear functions: F_0 and F_1 (N), what damping takes (J),
    the derivatives of F_0 and F_1 by both, and the curve from the deepest penetration so far."""

    f0: float
    f1: float
    lost: float
    f0_0: float
    f0_1: float
    f1_0: float
    f1_1: float
    back: Unloading


@kernel(copied=True)
def project(contact, free, by_0, by_1, guess_0, guess_1, curve, step_s):
    """Project the law along the gap that a force F_0, F_1 makes of the free one."""
    path = under(free, by_0, by_1, guess_0, guess_1)
    back = curve
    if contact.yield_m < math.inf:
        reached = in_series(contact, lowest(path), curve, guess_0)[3]
        if reached > curve.deepest:
            back = unloading(contact, reached)
    begin, end = touching_part(path, -curve.dent)
    f0 = f1 = lost = f0_0 = f0_1 = f1_0 = f1_1 = 0.0
    for i in range(_NODES):
        t, w = begin + (end - begin) * _T[i], (end - begin) * _W[i]
        gap, rate = quartic(path, t)
        # On the way down the contact goes on along its line, past the deepest point it comes back.
        guess = guess_0 + guess_1 * (2.0 * t - 1.0)
        force, slope, _, _ = in_series(contact, gap, curve if rate < 0.0 else back, guess)
        share = 1.0 / (1.0 + contact.residual_m_n * slope)  # of the gap's rate in that of p
        damper = 0.0
        if force > 0.0:
            damper = share * (contact.viscous_n_s_m + contact.hunt_crossley_s_m * force) / step_s
        by_gap = -slope * share * (1.0 - share * contact.hunt_crossley_s_m * rate / step_s)
        of_damper = -damper * rate
        gap_0, rate_0 = quartic(by_0, t)
        gap_1, rate_1 = quartic(by_1, t)
        change_0 = w * (by_gap * gap_0 - damper * rate_0)
        change_1 = w * (by_gap * gap_1 - damper * rate_1)
        tilt = 3.0 * (2.0 * t - 1.0)
        f0 += w * (force + of_damper)
        f1 += w * tilt * (force + of_damper)
        lost -= w * of_damper * rate
        f0_0 += change_0
        f0_1 += change_1
        f1_0 += tilt * change_0
        f1_1 += tilt * change_1
    return Projection(f0, f1, lost, f0_0, f0_1, f1_0, f1_1, back)


@kernel(part=True)
def solve_contact(contact, free, by_0, by_1, before, curve, guess_0, guess_1, step_s):
    """Contact force F_0 + F_1 P of a step.

    Args:
        contact: the law.
        free: the gap without this force; `by_0`, `by_1`: its change by a unit F_0 and F_1.
        before: work done on the contact so far, J; `curve`: from the deepest penetration before.
        guess_0, guess_1: F_0 and F_1 to begin with, N.
        step_s: length of the step.

    Returns:
        F_0, F_1 (N), what damping takes (J), the deepest penetration so far with this step (m),
        rounds, and whether Newton and the correction of energy ended. Where one does not, as with a
        step far too long, a constant force by the discrete gradient takes over, which conserves
        energy too; its deepest penetration is that before the step.
    """
    f0, f1 = guess_0, guess_1
    rounds, done, lost, back = 0, False, 0.0, curve
    while rounds < _NEWTON_MOST and not done:
        rounds += 1
        found = project(contact, free, by_0, by_1, f0, f1, curve, step_s)
        a, b = 1.0 - found.f0_0, -found.f0_1
        c, d = -found.f1_0, 1.0 - found.f1_1
        det = a * d - b * c
        if not det > 0.0:  # nor a number
            break
        wrong_0, wrong_1 = f0 - found.f0, f1 - found.f1
        change_0 = (d * wrong_0 - b * wrong_1) / det
        change_1 = (a * wrong_1 - c * wrong_0) / det
        f0 -= change_0
        f1 -= change_1
        done = abs(change_0) + abs(change_1) <= _TIGHT * (abs(f0) + abs(f1))
        lost, back = found.lost, found.back
    if done:
        f0, f1, done = _close_energy(contact, free, by_0, by_1, f0, f1, lost, before, back)
    if not done:
        f0, lost = _solve_discrete_gradient(contact, free, by_0, before, curve, step_s)
        f1, back = 0.0, curve
    return f0, f1, lost, back.deepest, rounds, done


@kernel(copied=True)
def _close_energy(contact, free, by_0, by_1, f0, f1, lost, before, back):
    """Least change of F_0, F_1 that closes the energy of the step, and whether it was found.

    The projection alone misses it a little: the rate of the gap is no linear function of time, so
    the work of its force is not the change of the stored energy. The work of F_0 + F_1 P on the
    modal gap is F_0 (x1 - x0) + F_1 (x1 + x0 - 2 mean).
    """
    last = math.inf
    for _ in range(_CORRECTIONS):
        end = free.end + by_0.end * f0 + by_1.end * f1
        mean = free.mean + by_0.mean * f0 + by_1.mean * f1
        way_0, way_1 = end - free.start, end + free.start - 2.0 * mean
        force, _, after, _ = in_series(contact, end, back, f0 + f1)
        wrong = f0 * way_0 + f1 * way_1 + (after - before) + lost
        size = abs(f0 * way_0) + abs(f1 * way_1) + after + before
        if abs(wrong) <= _ROUNDING * size or abs(wrong) >= last:
            return f0, f1, abs(wrong) <= _BALANCED * size
        last = abs(wrong)
        by_f0 = way_0 + (f0 - force) * by_0.end + f1 * (by_0.end - 2.0 * by_0.mean)
        by_f1 = way_1 + (f0 - force) * by_1.end + f1 * (by_1.end - 2.0 * by_1.mean)
        norm = by_f0 * by_f0 + by_f1 * by_f1
        if norm == 0.0:
            return f0, f1, wrong == 0.0
        f0 -= wrong / norm * by_f0
        f1 -= wrong / norm * by_f1
    return f0, f1, False


@kernel
def _discrete_gradient(contact, start, end, before, curve, step_s):
    """Discrete gradient between two modal gaps, F = (W_1 - W_0)/(gap_0 - gap_1) with damping: the
    constant force (N), and the damping alone."""
    force, _, after, p = in_series(contact, end, curve, 0.0)
    begun, _, _, p_0 = in_series(contact, start, curve, 0.0)
    if begun == 0.0 and force == 0.0:
        return 0.0, 0.0
    if end != start:
        force = (after - before) / (start - end)
    rate = (max(p - curve.dent, 0.0) - max(p_0 - curve.dent, 0.0)) / step_s
    damping = (contact.viscous_n_s_m + contact.hunt_crossley_s_m * max(force, 0.0)) * rate
    return force + damping, damping


@kernel
def _solve_discrete_gradient(contact, free, by_0, before, curve, step_s):
    """Constant force over the step by the discrete gradient, and what damping takes (J).

    A larger force leaves a larger gap at the end, which lowers the discrete gradient: the root lies
    between zero and the gradient to the end without force. Bisection always ends.
    """
    reach = _discrete_gradient(contact, free.start, free.end, before, curve, step_s)[0]
    low, high = min(0.0, reach), max(0.0, reach)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        end = free.end + by_0.end * middle
        if middle > _discrete_gradient(contact, free.start, end, before, curve, step_s)[0]:
            high = middle
        else:
            low = middle
    f0 = 0.5 * (low + high)
    end = free.end + by_0.end * f0
    damping = _discrete_gradient(contact, free.start, end, before, curve, step_s)[1]
    return f0, -damping * (end - free.start)
