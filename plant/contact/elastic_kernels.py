"""Compiled kernels of the contact in a step of the default scheme `modal`: all that is scalar.

The force is s p^(3/2). Given gap, velocity and mean of the gap as they would be without contact
force, and what a unit F_0 and F_1 change of them (`gains`), find the contact force F_0 + F_1 (2 t/h
- 1) of the step. See `plant.schemes.collocation_kernels` for the modes and the idea. In this order:
the Hertz contact in series with the spring of the modes left out; the gap within the step, a
quartic through its ends and its mean; the solve by Newton's method, and its balance of energy.

Products and sums may be contracted to multiply-adds: what is solved here is one long chain of
operations, each waiting for the last, and a quarter of its time goes with them.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import overload

from hertzloop.common.jit import kernel

NODES = 4
# Gauss-Legendre nodes and weights on (0, 1).
_half = 0.5 * np.polynomial.legendre.leggauss(NODES)[0] + 0.5
GAUSS_T = tuple(float(x) for x in _half)
GAUSS_W = tuple(0.5 * float(x) for x in np.polynomial.legendre.leggauss(NODES)[1])
GAUSS_P = tuple(3.0 * (2.0 * t - 1.0) for t in GAUSS_T)

NOTHING = (0.0,) * 11
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
NODE0, NODE1 = 41, 41 + NODES
GAINS = 41 + 2 * NODES

_NEWTON_MOST = 12
CORRECTIONS = 12
ROUNDING, BALANCED = 2e-16, 1e-13  # of the energies at hand: as good as can be, good enough
HALVINGS = 90
_TIGHT = 1e-7  # of the force; Newton squares what is left
# Of the gap at all nodes; what Newton leaves of the force is 0.4 times its square.
_NEAR = 3e-5
_SLIGHT = 1e-9  # of the gap: a correction that moves it less needs no second one
_SOFT = 0.2  # e of `root_penetration` below which its series and one Halley step give 1e-9


class ContactModel(NamedTuple):
    """A contact as its solve wants it, in whatever plant: kernels compiled for one serve another.

    `stiffness`: N/m^1.5; `flexibility_m_n`: of the modes left out; `gains`: (GAINS,).
    """

    step_s: float
    stiffness: float
    flexibility_m_n: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    gains: np.ndarray


@kernel(inline=True)
def contact_of(model, stiffness):
    """The contact of a plant's model, or its curve of another stiffness."""
    return ContactModel(
        model.step_s,
        stiffness,
        model.flexibility_m_n,
        model.viscous_n_s_m,
        model.hunt_crossley_s_m,
        model.gains,
    )


@kernel(inline=True, fastmath={"contract"})
def root_penetration(contact, gap):
    """y = sqrt(p) of the Hertz penetration p under a modal gap < 0: y^2 + k s y^3 = -gap.

    The spring of the modes left out takes k F = k s y^3 of the approach. Newton, from the series
    in e = k s sqrt(-gap) where that is small; what is left after a change of 3e-8 is below
    rounding.
    """
    y = math.sqrt(-gap)
    share = contact.flexibility_m_n * contact.stiffness
    if share == 0.0:
        return y
    e = share * y
    if e < 0.25:
        y *= 1.0 + e * (-0.5 + e * (0.625 + e * (-1.0 + e * (1.8046875 + e * -3.5))))
    else:
        y /= math.sqrt(1.0 + e)
    for _ in range(HALVINGS):
        change = (y * y * (1.0 + share * y) + gap) / (y * (2.0 + 3.0 * share * y))
        y -= change
        if abs(change) <= 3e-8 * y:
            break
    return y


@kernel(inline=True, fastmath={"contract"})
def elastic(contact, gap):
    """Contact force without damping (N) at a modal gap, the energy in the contact and in the
    spring of the modes left out (J), and the root of the penetration (m^0.5)."""
    if gap >= 0.0:
        return 0.0, 0.0, 0.0
    y = root_penetration(contact, gap)
    force = contact.stiffness * y * y * y
    return force, force * (0.4 * y * y + 0.5 * contact.flexibility_m_n * force), y


@kernel(inline=True, fastmath={"contract"})
def elastic_near(contact, gap, root):
    """The same from a root nearby, by one step of Halley's rule, which cubes what is wrong; from
    nothing if `root` is zero or not near enough."""
    if root == 0.0 or gap >= 0.0:
        return elastic(contact, gap)
    share = contact.flexibility_m_n * contact.stiffness
    wrong = root * root * (1.0 + share * root) + gap
    slope = root * (2.0 + 3.0 * share * root)
    change = wrong * slope / (slope * slope - wrong * (1.0 + 3.0 * share * root))
    if abs(change) > 3e-6 * root:
        return elastic(contact, gap)
    y = root - change
    force = contact.stiffness * y * y * y
    return force, force * (0.4 * y * y + 0.5 * contact.flexibility_m_n * force), y


@kernel(inline=True)
def slope_by_gap(contact, root):
    """dF/dgap of the contact without damping, N/m, by the root of `elastic`."""
    s, spring = contact.stiffness, contact.flexibility_m_n
    return -3.0 * s * root / (2.0 + 3.0 * spring * s * root)


@kernel(inline=True, fastmath={"contract"})
def damped_law(contact, gap, rate):
    """Force, its damping part, dF/dgap, dF/drate at a modal gap < 0 and its rate (m/s)."""
    s = contact.stiffness
    y = root_penetration(contact, gap)
    soft = 2.0 + 3.0 * contact.flexibility_m_n * s * y
    spring = s * y * y * y
    slope = -3.0 * s * y / soft
    if contact.viscous_n_s_m == 0.0 and contact.hunt_crossley_s_m == 0.0:
        return spring, 0.0, slope, 0.0
    share = -2.0 / soft  # dp/dgap
    factor = (contact.viscous_n_s_m + contact.hunt_crossley_s_m * spring) * share
    # The change of `share` with the gap is left to Newton's next iteration.
    return (
        spring + factor * rate,
        factor * rate,
        slope + contact.hunt_crossley_s_m * slope * share * rate,
        factor,
    )


@kernel(fastmath={"contract"})
def _chord(contact, x0, x1):
    """Discrete gradient between two modal gaps, damping included, and damping's part (N)."""
    if x0 >= 0.0 and x1 >= 0.0:
        return 0.0, 0.0
    a = root_penetration(contact, x0) if x0 < 0.0 else 0.0
    b = root_penetration(contact, x1) if x1 < 0.0 else 0.0
    s, share = contact.stiffness, contact.flexibility_m_n * contact.stiffness
    if (x0 < 0.0) != (x1 < 0.0):
        force = (elastic(contact, x1)[1] - elastic(contact, x0)[1]) / (x0 - x1)
    else:
        five = b**4 + b**3 * a + b * b * a * a + b * a**3 + a**4
        six = five * b + a**5
        way = b + a + share * (b * b + b * a + a * a)
        force = s * (0.4 * five + 0.5 * share * six) / way
    rate = (b * b - a * a) / contact.step_s
    damping = (contact.viscous_n_s_m + contact.hunt_crossley_s_m * force) * rate
    return force + damping, damping


def by_ends(t: float) -> tuple[float, float, float, float, float]:
    """The quartic of `quartic` at t, by x0, x1, d0, d1 and the mean."""
    u = 1.0 - t
    lift = 30.0 * t * t * u * u
    return (
        (1.0 + 2.0 * t) * u * u - 0.5 * lift,
        t * t * (3.0 - 2.0 * t) - 0.5 * lift,
        t * u * u - lift / 12.0,
        lift / 12.0 - t * t * u,
        lift,
    )


BY_X0, BY_X1, BY_D0, BY_D1, BY_MEAN = zip(*(by_ends(t) for t in GAUSS_T), strict=True)


@kernel(inline=True, fastmath={"contract"})
def quartic(t, x0, x1, d0, d1, q):
    """Gap and its derivative by t at t in (0, 1): ends, end slopes, excess of the mean."""
    u = 1.0 - t
    gap = (
        (1.0 + 2.0 * t) * u * u * x0
        + t * t * (3.0 - 2.0 * t) * x1
        + t * u * u * d0
        - t * t * u * d1
        + 30.0 * t * t * u * u * q
    )
    slope = (
        6.0 * t * u * (x1 - x0)
        + u * (1.0 - 3.0 * t) * d0
        + t * (3.0 * t - 2.0) * d1
        + 60.0 * t * u * (u - t) * q
    )
    return gap, slope


@kernel(fastmath={"contract"})
def crossing(negative, positive, x0, x1, d0, d1, q):
    """Where the quartic changes sign between t = negative (gap < 0) and t = positive."""
    for _ in range(HALVINGS):
        middle = 0.5 * (negative + positive)
        if middle == negative or middle == positive:
            break
        if quartic(middle, x0, x1, d0, d1, q)[0] < 0.0:
            negative = middle
        else:
            positive = middle
    return negative


@kernel(inline=True, fastmath={"contract"})
def touching_part(x0, x1, d0, d1, q):
    """The part (from, to) of the step that is in contact; from = to if none is."""
    if x0 < 0.0 and x1 < 0.0:
        return 0.0, 1.0
    if x0 < 0.0:
        return 0.0, crossing(0.0, 1.0, x0, x1, d0, d1, q)
    if x1 < 0.0:
        return crossing(1.0, 0.0, x0, x1, d0, d1, q), 1.0
    if d0 < 0.0 and d1 > 0.0:  # it may dip in and out again
        lowest, at = 0.0, -1.0
        for i in range(1, 16):
            gap = quartic(i / 16.0, x0, x1, d0, d1, q)[0]
            if gap < lowest:
                lowest, at = gap, i / 16.0
        if at > 0.0:
            return (crossing(at, 0.0, x0, x1, d0, d1, q), crossing(at, 1.0, x0, x1, d0, d1, q))
    return 0.0, 0.0


@kernel(inline=True, fastmath={"contract"})
def gap_at_node(i, x0, x1, d0, d1, mean):
    """Gap at node `i` of Gauss's rule."""
    return BY_X0[i] * x0 + BY_X1[i] * x1 + BY_D0[i] * d0 + BY_D1[i] * d1 + BY_MEAN[i] * mean


def added(sums, w, t, force, damping, slope, by_gap, by_slope):
    """Sums of a projection on linear functions - F_0, F_1, what damping takes (J), derivatives of
    F_0 and F_1 by x1, d1, the mean and d0 - with a node at t of weight `w` more, whose force (N)
    goes by the gap and its slope.

    Becomes part of its caller before that is compiled, which settles whether products and sums
    may be contracted.
    """
    f0, f1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m, f0_s, f1_s = sums
    u = 1.0 - t
    by_q = by_gap * (30.0 * t * t * u * u) + by_slope * (60.0 * t * u * (u - t))
    by_x = by_gap * t * t * (3.0 - 2.0 * t) + by_slope * 6.0 * t * u - 0.5 * by_q
    by_d = -by_gap * t * t * u + by_slope * t * (3.0 * t - 2.0) + by_q / 12.0
    by_s = by_gap * t * u * u + by_slope * u * (1.0 - 3.0 * t) - by_q / 12.0
    p = 3.0 * (2.0 * t - 1.0)
    return (
        f0 + w * force,
        f1 + w * p * force,
        lost - w * damping * slope,
        f0_x + w * by_x,
        f0_d + w * by_d,
        f0_m + w * by_q,
        f1_x + w * p * by_x,
        f1_d + w * p * by_d,
        f1_m + w * p * by_q,
        f0_s + w * by_s,
        f1_s + w * p * by_s,
    )


@overload(added, inline="always", jit_options={"_nrt": False})
def _compiled_added(sums, w, t, force, damping, slope, by_gap, by_slope):
    return added


def add_sphere(gains: np.ndarray, step_s: float, mass_kg: float) -> None:
    """Complete the gains of a structure by the motion of a sphere, in place: of the gap at the
    end, of its velocity, of its mean, and of the gap at the nodes; m/N, m/(N s)."""
    h, m = step_s, mass_kg
    gains[X0] = gains[PX0] + h * h / (2.0 * m)
    gains[X1] = gains[PX1] - h * h / (6.0 * m)
    gains[V0], gains[V1] = gains[PV0] + h / m, gains[PV1]
    gains[M0] = gains[PM0] + h * h / (6.0 * m)
    gains[M1] = gains[PM1] - h * h / (12.0 * m)
    x, d, mean, start = np.array(BY_X1), h * np.array(BY_D1), np.array(BY_MEAN), h * np.array(BY_D0)
    for node, of in ((NODE0, (X0, V0, M0, START0)), (NODE1, (X1, V1, M1, START1))):
        by = gains[list(of)]
        gains[node : node + NODES] = x * by[0] + d * by[1] + mean * by[2] + start * by[3]


@kernel(inline=True, fastmath={"contract"})
def slope_at_start(contact, d0, f0, f1):
    """Slope of the gap right at the start of a step (m a step) from that without its force: only a
    residual mode answers at once."""
    return d0 + contact.step_s * (contact.gains[START0] * f0 + contact.gains[START1] * f1)


@kernel(inline=True, fastmath={"contract"})
def _project(contact, x0, x1, d0, d1, mean):
    """Projection of the law along the quartic: F_0, F_1, what damping takes (J), and the
    derivatives of F_0 and F_1 by x1, d1, the mean and (only with a residual mode) d0."""
    q = mean - 0.5 * (x0 + x1) - (d0 - d1) / 12.0
    start, end = touching_part(x0, x1, d0, d1, q)
    sums = NOTHING
    if start == end:
        return sums
    h = contact.step_s
    for i in range(NODES):
        t = start + (end - start) * GAUSS_T[i]
        w = (end - start) * GAUSS_W[i]
        gap, slope = quartic(t, x0, x1, d0, d1, q)
        if gap >= 0.0:
            continue
        force, damping, by_gap, by_rate = damped_law(contact, gap, slope / h)
        sums = added(sums, w, t, force, damping, slope, by_gap, by_rate / h)
    return sums


@kernel(fastmath={"contract"})
def _solve_chord(contact, x0, free_x):
    """Constant force over the step by the discrete gradient, by bisection: always ends."""
    gain = contact.gains[X0]
    low = min(0.0, _chord(contact, x0, free_x)[0])
    high = max(0.0, _chord(contact, x0, free_x)[0])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if middle > _chord(contact, x0, free_x + gain * middle)[0]:
            high = middle
        else:
            low = middle
    f0 = 0.5 * (low + high)
    x1 = free_x + gain * f0
    return f0, -_chord(contact, x0, x1)[1] * (x1 - x0)


@kernel(inline=True, fastmath={"contract"})
def _solve_inside(contact, x0, d0, free_x, free_d, free_mean, guess0, guess1):
    """Newton for a step that is in contact all the way, without damping in the contact.

    The quartic is linear in F_0 and F_1, with coefficients at the nodes that do not change.
    Returns F_0, F_1, evaluations (none if the general way has to be taken) and the root of the
    penetration near the end (m^0.5).
    """
    g = contact.gains
    s = contact.stiffness
    share = contact.flexibility_m_n * s
    f0, f1 = guess0, guess1
    # While Newton works on the force the processor finds a root to start from when it is known.
    root = elastic(contact, free_x + g[X0] * f0 + g[X1] * f1)[2]
    for evaluation in range(1, _NEWTON_MOST):
        p0 = p1 = 0.0
        a = d = 1.0
        b = c = 0.0
        highest = max(x0, free_x + g[X0] * f0 + g[X1] * f1)
        lowest = min(x0, free_x + g[X0] * f0 + g[X1] * f1)
        for i in range(NODES):
            gap = (
                BY_X0[i] * x0
                + BY_X1[i] * free_x
                + BY_D0[i] * d0
                + BY_D1[i] * free_d
                + BY_MEAN[i] * free_mean
                + (g[NODE0 + i] * f0 + g[NODE1 + i] * f1)
            )
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
            w = GAUSS_W[i]
            p = GAUSS_P[i]
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
        for i in range(NODES):
            moved = max(moved, abs(g[NODE0 + i] * c0 + g[NODE1 + i] * c1))
        if moved <= -_NEAR * highest:
            return f0, f1, evaluation, root
    return guess0, guess1, 0, 0.0


@kernel(fastmath={"contract"})
def _solve_anywhere(contact, x0, d0, free_x, free_d, free_mean, guess0, guess1):
    """Newton for any step: F_0, F_1, what damping takes (J), evaluations, whether it ended."""
    g, h = contact.gains, contact.step_s
    f0, f1, lost = guess0, guess1, 0.0
    for evaluation in range(1, _NEWTON_MOST + 1):
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        d1 = free_d + h * (g[V0] * f0 + g[V1] * f1)
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        start = slope_at_start(contact, d0, f0, f1)
        p0, p1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m, f0_s, f1_s = _project(
            contact, x0, x1, start, d1, mean
        )
        a = 1.0 - (f0_x * g[X0] + f0_d * h * g[V0] + f0_m * g[M0]) - f0_s * h * g[START0]
        b = -(f0_x * g[X1] + f0_d * h * g[V1] + f0_m * g[M1]) - f0_s * h * g[START1]
        c = -(f1_x * g[X0] + f1_d * h * g[V0] + f1_m * g[M0]) - f1_s * h * g[START0]
        d = 1.0 - (f1_x * g[X1] + f1_d * h * g[V1] + f1_m * g[M1]) - f1_s * h * g[START1]
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


@kernel(inline=True, fastmath={"contract"})
def solve_contact(contact, x0, d0, free_x, free_d, free_mean, before, guess0, guess1):
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
    undamped = contact.viscous_n_s_m == 0.0 and contact.hunt_crossley_s_m == 0.0
    if x0 < 0.0 and undamped:
        f0, f1, evaluations, root = _solve_inside(
            contact, x0, d0, free_x, free_d, free_mean, guess0, guess1
        )
    done = evaluations > 0
    if not done:
        f0, f1, lost, evaluations, done = _solve_anywhere(
            contact, x0, d0, free_x, free_d, free_mean, guess0, guess1
        )
    if done:
        f0, f1, root, done = _balance(contact, x0, free_x, free_mean, f0, f1, lost, before, root)
    if not done:
        f0, lost = _solve_chord(contact, x0, free_x)
        f1 = root = 0.0
        evaluations += HALVINGS
    return f0, f1, lost, evaluations, root


@kernel(inline=True, fastmath={"contract"})
def _balance(contact, x0, free_x, free_mean, f0, f1, lost, before, root):
    """Least change of F_0, F_1 that closes the step's energy, the root of the penetration at
    the end before the last change, and whether it was found.

    `before`: energy in the contact at the start; `root`: near that at the end, or zero. The work
    of F_0 + F_1 P on the gap is F_0 (x1 - x0) + F_1 (x1 + x0 - 2 mean).
    """
    g = contact.gains
    last = math.inf
    for _ in range(CORRECTIONS):
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        way, bend = x1 - x0, x1 + x0 - 2.0 * mean
        force, after, root = elastic_near(contact, x1, root)
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
