"""Compiled kernels of a step of a contact that yields, F_0 + F_1 (2 t/h - 1) as the elastic one's.

The state's body keeps the deepest penetration so far and the curve that belongs to it,
F = s_u (p - dent)^1.5; before the first yield that is the Hertz curve up to delta_y. A step that
stays on its curve is solved as an elastic one of that stiffness, shifted by the dent; one that
stays on the line is linear; only one that turns, or changes between them, is put together
from pieces. The deepest penetration is that within the step: with that of its ends a step
that turns would be of second order.

The law itself is in `plant.contact.yielding`. The approach a = p + k F is the negative of a modal
gap: the penetration, and what the spring of the modes left out takes. The work done on the contact
is W = U + D, stored energy and what yielding took; D is a function of the deepest penetration.

The contact's law is a `Yielding`, or None: elastic.
"""

import math
from typing import NamedTuple

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import by_type, no, yes, zero
from hertzloop.plant.contact import elastic_kernels as elastic
from hertzloop.plant.state_kernels import CURVE, DEEPEST, DENT, PLASTIC_DISSIPATED, REACHED

_HALVINGS = 60
_NEWTON_MOST = 14
_TIGHT = 1e-9  # of the force
_ON_LINE = 1.0 - 1e-12  # of the deepest approach: there the line begins


class Yielding(NamedTuple):
    """Penetration (m), force (N) and energy (J) of first yield, and the line's rise (N/m)."""

    delta_m: float
    force_n: float
    rise_n_m: float
    energy_j: float


@kernel(inline=True)
def load(law, p):
    """Force on the line, N."""
    return law.force_n + law.rise_n_m * (p - law.delta_m)


@kernel(inline=True)
def curve_of(law, stiffness, deepest):
    """Stiffness (N/m^1.5) and dent (m) of the curve that belongs to a deepest penetration."""
    if deepest <= law.delta_m:
        return stiffness, 0.0
    most = load(law, deepest)
    again = stiffness * math.sqrt(stiffness * deepest * math.sqrt(deepest) / most)
    return again, deepest - (most / again) ** (2.0 / 3.0)


@kernel(inline=True)
def taken(law, deepest, dent):
    """What yielding took until a deepest penetration, J."""
    if deepest <= law.delta_m:
        return 0.0
    way = deepest - law.delta_m
    work = law.energy_j + way * (law.force_n + 0.5 * law.rise_n_m * way)
    return work - 0.4 * load(law, deepest) * (deepest - dent)


@kernel(inline=True)
def approach(law, contact, p):
    """Approach at a penetration on the line, m."""
    return p + contact.flexibility_m_n * load(law, p)


@kernel(inline=True)
def penetration(law, contact, approach):
    """Penetration at an approach on the line, m."""
    start = law.delta_m + contact.flexibility_m_n * law.force_n
    return law.delta_m + (approach - start) / (1.0 + contact.flexibility_m_n * law.rise_n_m)


@kernel
def work(law, contact, gap, deepest):
    """Force (N) at a gap and W (J) for a deepest penetration before it, which it may pass."""
    spring = contact.flexibility_m_n
    if -gap >= approach(law, contact, deepest):
        p = penetration(law, contact, -gap)
        force, way = load(law, p), p - law.delta_m
        done = law.energy_j + way * (law.force_n + 0.5 * law.rise_n_m * way)
        return force, done + 0.5 * spring * force * force
    stiffness, dent = curve_of(law, contact.stiffness, deepest)
    force, stored, _ = elastic.elastic(elastic.contact_of(contact, stiffness), gap + dent)
    return force, stored + taken(law, deepest, dent)


@kernel(inline=True)
def at(law, contact, gap, rate, curve, dent, on_line):
    """Force, its damping part, dF/dgap and dF/drate on the line, or on a curve."""
    if not on_line:
        if gap + dent >= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        return elastic.damped_law(curve, gap + dent, rate)
    spring = load(law, penetration(law, contact, -gap))
    share = -1.0 / (1.0 + contact.flexibility_m_n * law.rise_n_m)
    slope = law.rise_n_m * share
    factor = (contact.viscous_n_s_m + contact.hunt_crossley_s_m * spring) * share
    by_gap = slope + contact.hunt_crossley_s_m * slope * share * rate
    return spring + factor * rate, factor * rate, by_gap, factor


@kernel
def _crossing(level, low, high, x0, x1, d0, d1, q):
    """Where the quartic passes `level` between t = low and t = high."""
    falls = elastic.quartic(low, x0, x1, d0, d1, q)[0] > level
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if (elastic.quartic(middle, x0, x1, d0, d1, q)[0] > level) == falls:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _turning(x0, x1, d0, d1, q):
    """Where the quartic is lowest: an end of the step or a turning point inside."""
    if d0 >= 0.0 or d1 <= 0.0:
        return 0.0 if x0 < x1 else 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if elastic.quartic(middle, x0, x1, d0, d1, q)[1] < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _add(law, contact, sums, begin, end, x0, x1, d0, d1, q, curve, dent, on_line):
    """Add a piece of the step to the projection: F_0, F_1, loss, derivatives of F_0 and F_1 by
    x1, d1, the mean and d0."""
    if end > begin:
        for i in range(elastic.NODES):
            t = begin + (end - begin) * elastic.GAUSS_T[i]
            w = (end - begin) * elastic.GAUSS_W[i]
            gap, slope = elastic.quartic(t, x0, x1, d0, d1, q)
            force, damping, by_gap, by_rate = at(
                law, contact, gap, slope / contact.step_s, curve, dent, on_line
            )
            sums = elastic.added(
                sums, w, t, force, damping, slope, by_gap, by_rate / contact.step_s
            )
    return sums


@kernel
def _project(law, contact, body, x0, x1, d0, d1, mean):
    """Projection of the law along the quartic, as `_add`, and the deepest penetration in it."""
    q = mean - 0.5 * (x0 + x1) - (d0 - d1) / 12.0
    deepest, dent = body[DEEPEST], body[DENT]
    curve = elastic.contact_of(contact, body[CURVE])
    sums = elastic.NOTHING
    level = approach(law, contact, deepest)
    turn = _turning(x0, x1, d0, d1, q)
    lowest = elastic.quartic(turn, x0, x1, d0, d1, q)[0]
    if -lowest <= level:
        begin, end = elastic.touching_part(x0 + dent, x1 + dent, d0, d1, q)
        sums = _add(law, contact, sums, begin, end, x0, x1, d0, d1, q, curve, dent, False)
        return sums, deepest
    begin = 0.0
    if x0 + dent > 0.0:
        begin = _crossing(-dent, 0.0, turn, x0, x1, d0, d1, q)
    line = 0.0
    if -x0 < level:
        line = _crossing(-level, begin, turn, x0, x1, d0, d1, q)
    sums = _add(law, contact, sums, begin, line, x0, x1, d0, d1, q, curve, dent, False)
    sums = _add(law, contact, sums, line, turn, x0, x1, d0, d1, q, curve, dent, True)
    deepest = penetration(law, contact, -lowest)
    stiffness, dent = curve_of(law, contact.stiffness, deepest)
    end = 1.0
    if x1 + dent > 0.0:
        end = _crossing(-dent, turn, 1.0, x0, x1, d0, d1, q)
    after = elastic.contact_of(contact, stiffness)
    sums = _add(law, contact, sums, turn, end, x0, x1, d0, d1, q, after, dent, False)
    return sums, deepest


@kernel
def _pieces(law, contact, body, x0, d0, free_x, free_d, free_mean, guess0, guess1):
    """Newton for any step: F_0, F_1, what damping takes (J), evaluations, whether it ended, and
    the deepest penetration within the step (m)."""
    g, h = contact.gains, contact.step_s
    f0, f1, lost, deepest = guess0, guess1, 0.0, body[DEEPEST]
    for evaluation in range(1, _NEWTON_MOST + 1):
        x1 = free_x + g[elastic.X0] * f0 + g[elastic.X1] * f1
        d1 = free_d + h * (g[elastic.V0] * f0 + g[elastic.V1] * f1)
        mean = free_mean + g[elastic.M0] * f0 + g[elastic.M1] * f1
        start = elastic.slope_at_start(contact, d0, f0, f1)
        sums, deepest = _project(law, contact, body, x0, x1, start, d1, mean)
        p0, p1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m, f0_s, f1_s = sums
        a = 1.0 - (f0_x * g[elastic.X0] + f0_d * h * g[elastic.V0] + f0_m * g[elastic.M0])
        b = -(f0_x * g[elastic.X1] + f0_d * h * g[elastic.V1] + f0_m * g[elastic.M1])
        c = -(f1_x * g[elastic.X0] + f1_d * h * g[elastic.V0] + f1_m * g[elastic.M0])
        d = 1.0 - (f1_x * g[elastic.X1] + f1_d * h * g[elastic.V1] + f1_m * g[elastic.M1])
        a -= f0_s * h * g[elastic.START0]
        b -= f0_s * h * g[elastic.START1]
        c -= f1_s * h * g[elastic.START0]
        d -= f1_s * h * g[elastic.START1]
        det = a * d - b * c
        if not det > 0.0:
            break
        c0 = (d * (f0 - p0) - b * (f1 - p1)) / det
        c1 = (a * (f1 - p1) - c * (f0 - p0)) / det
        f0 -= c0
        f1 -= c1
        if abs(c0) + abs(c1) <= _TIGHT * (abs(f0) + abs(f1)):
            return f0, f1, lost, evaluation, True, deepest
    return f0, f1, lost, _NEWTON_MOST, False, deepest


@kernel
def _line(law, contact, x0, d0, free_x, free_d, free_mean):
    """F_0 and F_1 of a step that stays on the line, without damping: two linear equations."""
    g, h = contact.gains, contact.step_s
    rise = law.rise_n_m / (1.0 + contact.flexibility_m_n * law.rise_n_m)
    level = load(law, penetration(law, contact, 0.0))
    p0, p1 = level, 0.0
    a = d = 1.0
    b = c = 0.0
    for i in range(elastic.NODES):
        gap = elastic.gap_at_node(i, x0, free_x, d0, free_d, free_mean)
        w, p = elastic.GAUSS_W[i], elastic.GAUSS_P[i]
        n0, n1 = g[elastic.NODE0 + i], g[elastic.NODE1 + i]
        p0 -= rise * w * gap
        p1 -= rise * w * p * gap
        a += rise * w * n0
        b += rise * w * n1
        c += rise * w * p * n0
        d += rise * w * p * n1
    det = a * d - b * c
    f0, f1 = (d * p0 - b * p1) / det, (a * p1 - c * p0) / det
    return f0, f1, free_d + h * (g[elastic.V0] * f0 + g[elastic.V1] * f1)


@kernel
def _balance(law, contact, x0, free_x, free_mean, f0, f1, lost, before, deepest):
    """Least change of F_0, F_1 that closes the step's energy: that of `elastic_kernels` with the
    work of a contact that yields. `before`: that work at the start, J."""
    g = contact.gains
    last = math.inf
    for _ in range(elastic.CORRECTIONS):
        x1 = free_x + g[elastic.X0] * f0 + g[elastic.X1] * f1
        mean = free_mean + g[elastic.M0] * f0 + g[elastic.M1] * f1
        way, bend = x1 - x0, x1 + x0 - 2.0 * mean
        force, after = work(law, contact, x1, deepest)
        wrong = f0 * way + f1 * bend + (after - before) + lost
        size = abs(f0 * way) + abs(f1 * bend) + after + before
        if abs(wrong) <= elastic.ROUNDING * size or abs(wrong) >= last:
            return f0, f1, abs(wrong) <= elastic.BALANCED * size
        last = abs(wrong)
        by0 = (
            way
            + f0 * g[elastic.X0]
            + f1 * (g[elastic.X0] - 2.0 * g[elastic.M0])
            - force * g[elastic.X0]
        )
        by1 = (
            bend
            + f0 * g[elastic.X1]
            + f1 * (g[elastic.X1] - 2.0 * g[elastic.M1])
            - force * g[elastic.X1]
        )
        norm = by0 * by0 + by1 * by1
        if norm == 0.0:
            return f0, f1, wrong == 0.0
        f0 -= wrong / norm * by0
        f1 -= wrong / norm * by1
    return f0, f1, False


@kernel
def _chord(law, contact, x0, x1, before, deepest):
    """Discrete gradient between two gaps, damping included, and damping's part (N)."""
    force, after = work(law, contact, x1, deepest)
    if x1 != x0:
        force = (after - before) / (x0 - x1)
    # The spring takes its share of the approach: what is left is the change of penetration.
    start = work(law, contact, x0, deepest)[0]
    end = work(law, contact, x1, deepest)[0]
    spring = contact.flexibility_m_n
    rate = (min(x0, 0.0) - min(x1, 0.0) - spring * (end - start)) / contact.step_s
    if start == 0.0 and end == 0.0:
        return force, 0.0
    damping = (contact.viscous_n_s_m + contact.hunt_crossley_s_m * max(force, 0.0)) * rate
    return force + damping, damping


@kernel
def _solve_chord(law, contact, x0, free_x, before, deepest):
    """Constant force over the step by the discrete gradient, by bisection: always ends."""
    gain = contact.gains[elastic.X0]
    reach = _chord(law, contact, x0, free_x, before, deepest)[0]
    low, high = min(0.0, reach), max(0.0, reach)
    for _ in range(_HALVINGS + 30):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if middle > _chord(law, contact, x0, free_x + gain * middle, before, deepest)[0]:
            high = middle
        else:
            low = middle
    f0 = 0.5 * (low + high)
    x1 = free_x + gain * f0
    return f0, -_chord(law, contact, x0, x1, before, deepest)[1] * (x1 - x0)


@kernel
def _solve(law, contact, body, x0, d0, free_x, free_d, free_mean, before, guess0, guess1):
    """`elastic_kernels.solve_contact` of a contact that yields; leaves the deepest penetration of
    the step in body[REACHED]."""
    g, h = contact.gains, contact.step_s
    deepest, dent = body[DEEPEST], body[DENT]
    level = approach(law, contact, deepest)
    body[REACHED] = deepest
    evaluations = 0
    on_line = -x0 >= _ON_LINE * level and d0 < 0.0
    damped = contact.viscous_n_s_m != 0.0 or contact.hunt_crossley_s_m != 0.0
    if not on_line:
        f0, f1, lost, evaluations, root = elastic.solve_contact(
            elastic.contact_of(contact, body[CURVE]),
            x0 + dent,
            d0,
            free_x + dent,
            free_d,
            free_mean + dent,
            before,
            guess0,
            guess1,
        )
        x1 = free_x + g[elastic.X0] * f0 + g[elastic.X1] * f1
        d1 = free_d + h * (g[elastic.V0] * f0 + g[elastic.V1] * f1)
        lowest = min(x0, x1)
        start = elastic.slope_at_start(contact, d0, f0, f1)
        if start < 0.0 < d1:
            mean = free_mean + g[elastic.M0] * f0 + g[elastic.M1] * f1
            q = mean - 0.5 * (x0 + x1) - (start - d1) / 12.0
            lowest = elastic.quartic(_turning(x0, x1, start, d1, q), x0, x1, start, d1, q)[0]
        if -lowest <= level:
            return f0, f1, lost, evaluations, root
        guess0, guess1 = f0, f1
    lost = 0.0
    done = False
    f0, f1 = guess0, guess1
    if on_line and not damped:
        f0, f1, d1 = _line(law, contact, x0, d0, free_x, free_d, free_mean)
        evaluations += 1
        done = d1 < 0.0
    reached = deepest
    if not done:
        f0, f1, lost, more, done, reached = _pieces(
            law, contact, body, x0, d0, free_x, free_d, free_mean, f0, f1
        )
        evaluations += more
        # On a line to the end of the step the deepest point is where the balance puts it.
        d1 = free_d + h * (g[elastic.V0] * f0 + g[elastic.V1] * f1)
        if d1 <= 0.0:
            reached = deepest
    work = before + taken(law, deepest, dent)
    if done:
        f0, f1, done = _balance(law, contact, x0, free_x, free_mean, f0, f1, lost, work, reached)
    if not done:
        reached = deepest
        f0, lost = _solve_chord(law, contact, x0, free_x, work, deepest)
        f1 = 0.0
        evaluations += _HALVINGS
    body[REACHED] = reached
    return f0, f1, lost, evaluations, 0.0


@kernel(inline=True)
def _settle(law, contact, state, gap, root):
    """Let the contact be at a modal gap after a step: its deepest point, its curve, what yielding
    took. Force (N), energy in contact and spring (J), root of the penetration above the dent."""
    body = state.body
    deepest = max(body[DEEPEST], body[REACHED])
    if -gap > approach(law, contact, deepest):
        deepest = penetration(law, contact, -gap)
    if deepest > body[DEEPEST]:
        body[DEEPEST] = deepest
        body[CURVE], body[DENT] = curve_of(law, contact.stiffness, deepest)
        state.balance[PLASTIC_DISSIPATED] = taken(law, deepest, body[DENT])
        root = 0.0
    return elastic.elastic_near(elastic.contact_of(contact, body[CURVE]), gap + body[DENT], root)


@kernel(inline=True)
def _dent(law, body):
    return body[DENT]


@kernel(inline=True)
def _slope(law, contact, body, gap, root, approaching):
    if approaching and -gap >= _ON_LINE * approach(law, contact, body[DEEPEST]):
        return -law.rise_n_m / (1.0 + contact.flexibility_m_n * law.rise_n_m)
    s = body[CURVE]
    return -3.0 * s * root / (2.0 + 3.0 * contact.flexibility_m_n * s * root)


@kernel(inline=True)
def _elastic_slope(law, contact, body, gap, root, approaching):
    return elastic.slope_by_gap(contact, root)


@kernel(inline=True)
def _elastic(law, contact, body, x0, d0, free_x, free_d, free_mean, before, guess0, guess1):
    return elastic.solve_contact(contact, x0, d0, free_x, free_d, free_mean, before, guess0, guess1)


@kernel(inline=True)
def _settle_elastic(law, contact, state, gap, root):
    return elastic.elastic_near(contact, gap, root)


# Each by the type of the law, known when a caller is compiled. Whether it can yield; what is left
# of the contact (m), below which there is none; dF/dgap at a modal gap; the force of a step; its
# end.
yields = by_type({type(None): no, Yielding: yes})
dent = by_type({type(None): zero, Yielding: _dent})
slope = by_type({type(None): _elastic_slope, Yielding: _slope})
solve_contact = by_type({type(None): _elastic, Yielding: _solve})
settle = by_type({type(None): _settle_elastic, Yielding: _settle})
