"""Compiled kernels of the scheme `thesis2008`: the published numerics taken literally.

Flaws included, so that published metrics can be reproduced (C. Hoever, TU Berlin/Chalmers
2008). Samples of an impact are n = 0, 1, ... from xi = 0 on; F = -F_c - F_nu + F_a:

- plate acceleration a_p[n] = -dt sum_{j>=1} g_a[j] F[n-j], with the sampled half-sided
  Green's function and its leading minus sign;
- Hilber-Hughes-Taylor as printed, alpha = -1/3: velocity and displacement advance by
  -alpha times the Newmark increment;
- Newton's method to |da| < dt;
- contact ends at the first xi > 0; the sphere leaves with the relative velocity plus the
  plate velocity v_p[n] = dt sum_{j>=0} g_v[j] F'[n-j], F' = -F_c + F_a without damping.

Between impacts the published procedure knows no plate: the sphere flies over a plate at
rest, and every impact begins anew.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common import elementary_kernels
from hertzloop.common.jit import kernel
from hertzloop.plant import state_kernels
from hertzloop.plant.state_kernels import (
    A_P,
    CONTACT_DISSIPATED,
    CONTACT_IMPULSE,
    CONTACT_STEPS,
    F_A,
    F_C,
    FALLBACKS,
    FLIGHT_STEP,
    FLIGHT_V,
    FLIGHT_X,
    INJECTED,
    MODAL_DISSIPATED,
    NEWTON_MAX,
    NEWTON_TOTAL,
    STEP,
    V_P,
    V_P_OF_STEP,
    XI,
    XI_A,
    XI_P,
    XI_S,
)

ALPHA = -1.0 / 3.0
ADVANCE = -ALPHA
GAMMA = 0.5 * (1.0 - 2.0 * ALPHA)
BETA = 0.25 * (1.0 - ALPHA) ** 2

# Contact damping; RELAXATION sums its memory and iterates as published, RELAXATION_STATE has
# the same law with the memory as one extra state and a bracketed solve.
VISCOUS, RELAXATION, RELAXATION_STATE = range(3)
# Indices into ThesisState.motion: relative velocity and acceleration, memory of the
# relaxation (N/m^0.5), elastic and damping force of the present sample (N).
REL_V, REL_A, MEMORY, ELASTIC, DAMPING = range(5)
MOTION_SIZE = 5
# Further indices into ThesisState.counts, after those of `state_kernels`.
BEGAN, TOUCHING, NEXT_IMPACT = range(state_kernels.COUNTS_SIZE, state_kernels.COUNTS_SIZE + 3)
COUNTS_SIZE = state_kernels.COUNTS_SIZE + 3
_HALVINGS = 200
_NEWTON_ALONE = 12  # then bisection takes turns with Newton
_ROUNDING = 1e-15
_DIED_AWAY = 1e-30  # of a mode's first value; numbers that small would become denormal and slow
_TOUCH_M = 1e-300  # above contact, however the last digit falls


class ThesisModel(NamedTuple):
    """What does not change during a run. `green_*`: response of displacement (m/N s),
    velocity and acceleration at the contact point to a unit impulse, one value a step of
    the longest run.

    Relaxation: F = (s_rel p - (s_tau/tau) int p(t') exp(-(t - t')/tau) dt') sqrt(p) with
    s_rel = s + (dt/tau) s_tau, so that the sum's own sample leaves s p.
    """

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    damping: int
    viscous_n_s_m: float
    relaxation_stiffness: float
    relaxation_s: float
    most_iterations: int
    same_point: bool
    green_x: np.ndarray
    green_v: np.ndarray
    green_a: np.ndarray


class ThesisState(NamedTuple):
    """What changes. `body`, `balance` and the first counts as in the modal scheme; `total` and
    `undamped`: force on the plate with and without damping, `depth`: penetration, one a
    sample of the present impact; `decay`: weights of the relaxation's memory."""

    body: np.ndarray
    balance: np.ndarray
    counts: np.ndarray
    motion: np.ndarray
    total: np.ndarray
    undamped: np.ndarray
    depth: np.ndarray
    decay: np.ndarray


@kernel
def add_modes(s_re, s_im, weight, step_s, powers, first, turn, total):
    """Add Im(weight s^i e^(s t)) of all modes to `total[i]`, i = 0, 1, 2; all arithmetic strict.

    Times are those of blocks: t = (block size + j) step_s. A mode's powers within a block are a
    table, and at its start a factor that turns from block to block.

    Args:
        s_re, s_im: exponents of the modes, 1/s, shape (modes,).
        weight: of the modes, shape (modes,).
        powers, first, turn: room for some modes that are added together, shapes (some, 2, size),
            (some, 3, 2) and (some, 2).
        total: sums, shape (3, blocks, size).
    """
    together = powers.shape[0]
    for start in range(0, weight.size, together):
        count = min(together, weight.size - start)
        for k in range(count):
            re, im = s_re[start + k], s_im[start + k]
            _powers(re * step_s, im * step_s, powers[k], turn[k])
            a, b = weight[start + k], 0.0
            for i in range(3):
                first[k, i, 0], first[k, i, 1] = a, b
                a, b = a * re - b * im, a * im + b * re
        for block in range(total.shape[1]):
            for k in range(count):
                if abs(first[k, 0, 0]) + abs(first[k, 0, 1]) < _DIED_AWAY * weight[start + k]:
                    continue
                _add_block(first[k], powers[k], total[:, block])
                c, d = turn[k, 0], turn[k, 1]
                for i in range(3):
                    a, b = first[k, i, 0], first[k, i, 1]
                    first[k, i, 0], first[k, i, 1] = a * c - b * d, a * d + b * c


@kernel
def _powers(re, im, table, turn):
    """Powers 0, 1, 2 ... of e^(re + i im), shape (2, size), and the first one beyond."""
    size = table.shape[1]
    decay = elementary_kernels.exp(re)
    sine, cosine = elementary_kernels.sine_and_cosine(im)
    table[0, 0], table[1, 0] = 1.0, 0.0
    table[0, 1], table[1, 1] = decay * cosine, decay * sine
    for j in range(2, size + 1):
        one, other = j // 2, j - j // 2
        a, b, c, d = table[0, one], table[1, one], table[0, other], table[1, other]
        if j < size:
            table[0, j], table[1, j] = a * c - b * d, a * d + b * c
        else:
            turn[0], turn[1] = a * c - b * d, a * d + b * c


@kernel
def _add_block(first, table, found):
    """Add Im(first[i] table) to `found[i]`, i = 0, 1, 2, over one block."""
    x, v, a = found[0], found[1], found[2]
    re, im = table[0], table[1]
    x_re, x_im = first[0, 0], first[0, 1]
    v_re, v_im = first[1, 0], first[1, 1]
    a_re, a_im = first[2, 0], first[2, 1]
    for j in range(re.size):
        x[j] += x_re * im[j] + x_im * re[j]
        v[j] += v_re * im[j] + v_im * re[j]
        a[j] += a_re * im[j] + a_im * re[j]


@kernel
def fill_decay(step_s, relaxation_s, decay):
    """Write e^(-t/tau) at 0, dt, 2 dt ... into `decay`."""
    for n in range(decay.size):
        decay[n] = elementary_kernels.exp(-(n * step_s) / relaxation_s)


@kernel
def _memory_before(model, state, n):
    """Relaxation memory at sample n from the samples before it, N/m^0.5."""
    if model.damping == RELAXATION:  # the published sum
        total = 0.0
        for j in range(1, n + 1):
            total += state.decay[j] * state.depth[n - j]
        return model.relaxation_stiffness * model.step_s / model.relaxation_s * total
    weight = model.relaxation_stiffness * model.step_s / model.relaxation_s
    return (state.motion[MEMORY] + weight * state.depth[n - 1]) * state.decay[1]


@kernel
def _force(model, xi, v, memory):
    """Elastic part, damping part and derivative by xi of the contact force at a sample.

    `memory` (N/m^0.5) is that of the samples before; it pulls with memory sqrt(p).
    """
    p = max(-xi, 0.0)
    root = math.sqrt(p)
    elastic = model.stiffness * p * root
    if model.damping == VISCOUS:
        return elastic, -model.viscous_n_s_m * v, -1.5 * model.stiffness * root
    slope = -1.5 * model.stiffness * root
    if p > 0.0:
        slope += 0.5 * memory / root
    return elastic, -memory * root, slope


@kernel
def _residual(model, a, x, w, push, memory):
    """Equation of motion at acceleration a: residual, its derivative, xi, v, force parts.

    xi = x + f beta dt^2 a, v = w + f gamma dt a; `push` = -g - a_p.
    """
    to_x = ADVANCE * BETA * model.step_s * model.step_s
    to_v = ADVANCE * GAMMA * model.step_s
    xi = x + to_x * a
    v = w + to_v * a
    elastic, damping, slope = _force(model, xi, v, memory)
    residual = a - (elastic + damping) / model.mass_kg - push
    derivative = 1.0 - slope * to_x / model.mass_kg
    if model.damping == VISCOUS:
        derivative += model.viscous_n_s_m * to_v / model.mass_kg
    return residual, derivative, xi, v, elastic, damping


@kernel
def _newton_2008(model, a, x, w, push, memory):
    """Newton's method as published: until |da| < dt. Returns a and iterations, minus their
    number if the most allowed did not do.

    Far from any impact, rounding alone exceeds dt, and `a` goes round in circles (found as by
    R. P. Brent, 1980): those that change nothing any more are left out.
    """
    left = model.most_iterations
    kept, since = a, 0
    while left > 0:
        residual, derivative, _, _, _, _ = _residual(model, a, x, w, push, memory)
        change = -residual / derivative
        a += change
        left -= 1
        done = model.most_iterations - left
        if abs(change) < model.step_s:
            return a, done
        if math.isnan(a):
            break
        since += 1
        if a == kept:
            left %= since
        elif done & (done - 1) == 0:
            kept, since = a, 0
    return a, -model.most_iterations


@kernel
def _bracketed(model, x, w, push, memory):
    """The same equation by Newton inside a bracket, to rounding. Returns a and evaluations.

    If the sphere leaves without a force, that is the solution. Otherwise the residual is
    not negative where the sphere just leaves, tends to minus infinity with the penetration,
    and has one root in between, also where the memory makes the force negative.
    """
    to_x = ADVANCE * BETA * model.step_s * model.step_s
    if x + to_x * push > 0.0:
        return push, 1
    high = -x / to_x
    low = push
    evaluations = 1
    while _residual(model, low, x, w, push, memory)[0] > 0.0 and evaluations < _HALVINGS:
        low -= max(2.0 * (high - low), 1.0)
        evaluations += 1
    a = low
    for halving in range(_HALVINGS):
        residual, derivative, _, _, elastic, damping = _residual(model, a, x, w, push, memory)
        evaluations += 1
        scale = abs(a) + abs(push) + (abs(elastic) + abs(damping)) / model.mass_kg
        if abs(residual) <= _ROUNDING * scale:
            break
        if residual > 0.0:
            high = a
        else:
            low = a
        trial = a - residual / derivative
        exhausted = False
        if not low <= trial <= high or (halving > _NEWTON_ALONE and halving % 2 == 0):
            trial = 0.5 * (low + high)
            exhausted = trial <= low or trial >= high
        if trial == a or exhausted:
            break
        a = trial
    return a, evaluations


@kernel
def begin_impact(model, state, step, speed):
    """Contact begins at sample n = 0: xi = 0, v = -speed, a = -g, plate at rest."""
    body, counts, motion = state.body, state.counts, state.motion
    counts[BEGAN] = step
    counts[TOUCHING] = 1
    motion[:] = 0.0
    motion[REL_V] = -speed
    motion[REL_A] = -model.gravity_m_s2
    state.depth[0] = 0.0
    body[XI] = body[XI_S] = body[XI_P] = body[XI_A] = 0.0
    body[V_P] = body[A_P] = 0.0
    body[FLIGHT_V] = -speed


@kernel
def _end_impact(model, state, n, step):
    """The sphere leaves at sample n: relative velocity plus that of the plate."""
    body, counts = state.body, state.counts
    plate = 0.0
    for j in range(n + 1):
        plate += model.green_v[j] * state.undamped[n - j]
    speed = state.motion[REL_V] + model.step_s * plate
    counts[TOUCHING] = 0
    counts[FLIGHT_STEP] = step
    body[FLIGHT_X] = body[XI]
    body[FLIGHT_V] = speed
    # It falls back on a plate at rest; one that does not rise at all is hit at once.
    fall_steps = math.ceil(2.0 * speed / (model.gravity_m_s2 * model.step_s))
    counts[NEXT_IMPACT] = step + max(fall_steps, 1)


@kernel
def _fly(model, state):
    """One step without contact, over a plate at rest."""
    body, counts = state.body, state.counts
    step = counts[STEP] + 1
    if step >= counts[NEXT_IMPACT]:
        fall = 2.0 * model.gravity_m_s2 * body[FLIGHT_X]
        speed = math.sqrt(body[FLIGHT_V] * body[FLIGHT_V] + fall)
        begin_impact(model, state, step, speed)
        return
    t = (step - counts[FLIGHT_STEP]) * model.step_s
    height = body[FLIGHT_X] + t * (body[FLIGHT_V] - 0.5 * model.gravity_m_s2 * t)
    body[XI] = body[XI_S] = max(height, _TOUCH_M)
    body[XI_P] = body[XI_A] = body[V_P] = body[A_P] = 0.0


@kernel
def _touch(model, state, n):
    """One step in contact, from sample n - 1 to n."""
    body, motion, counts, dt = state.body, state.motion, state.counts, model.step_s
    plate_a = 0.0
    plate_v = 0.0
    plate_x = 0.0
    for j in range(1, n + 1):
        plate_a -= model.green_a[j] * state.total[n - j]
        plate_v += model.green_v[j] * state.undamped[n - j]
        plate_x += model.green_x[j] * state.undamped[n - j]
    a0, v0 = motion[REL_A], motion[REL_V]
    x = body[XI] + ADVANCE * (dt * v0 + dt * dt * (0.5 - BETA) * a0)
    w = v0 + ADVANCE * dt * (1.0 - GAMMA) * a0
    push = -model.gravity_m_s2 - dt * plate_a
    memory = 0.0
    if model.damping != VISCOUS:
        memory = _memory_before(model, state, n)
    if model.damping == RELAXATION_STATE:
        a, iterations = _bracketed(model, x, w, push, memory)
    else:
        a, iterations = _newton_2008(model, a0, x, w, push, memory)
    if iterations < 0:  # it gave up
        counts[FALLBACKS] += 1
        iterations = -iterations
    counts[NEWTON_TOTAL] += iterations
    counts[NEWTON_MAX] = max(counts[NEWTON_MAX], iterations)
    counts[CONTACT_STEPS] += 1
    _, _, xi, v, elastic, damping = _residual(model, a, x, w, push, memory)
    motion[REL_A] = a
    motion[REL_V] = v
    motion[MEMORY] = memory
    touching = xi <= 0.0
    motion[ELASTIC] = elastic if touching else 0.0
    motion[DAMPING] = damping if touching else 0.0
    state.depth[n] = -xi if touching else 0.0
    body[XI] = xi
    body[XI_P] = body[XI_A] = dt * plate_x
    body[XI_S] = xi + dt * plate_x
    body[V_P] = dt * (plate_v - model.green_v[0] * motion[ELASTIC])
    body[A_P] = dt * plate_a


@kernel
def _book(model, state, f_a):
    """What the present sample's forces do over a step, at the velocities of the sample."""
    body, balance, motion, h = state.body, state.balance, state.motion, model.step_s
    balance[CONTACT_IMPULSE] += (motion[ELASTIC] + motion[DAMPING]) * h
    balance[CONTACT_DISSIPATED] -= motion[DAMPING] * motion[REL_V] * h
    balance[INJECTED] += f_a * body[V_P_OF_STEP] * h
    balance[MODAL_DISSIPATED] += (f_a - motion[ELASTIC]) * body[V_P_OF_STEP] * h


@kernel
def step(model, state, f_a):
    """Advance one step under the actuator force `f_a` (N) of the present sample; returns the
    contact force (N) of that sample, damping included.

    The sampled convolution lets a force move the plate at once (j = 0), so the plate velocity
    of a sample is complete only when `f_a` is known. `balance[MODAL_DISSIPATED]` takes all work
    on the plate.
    """
    body, counts, motion = state.body, state.counts, state.motion
    present = counts[STEP]
    force = 0.0
    body[V_P_OF_STEP] = body[V_P]
    if counts[TOUCHING] == 1:
        body[V_P_OF_STEP] += model.step_s * model.green_v[0] * f_a
        n = present - counts[BEGAN]
        force = motion[ELASTIC] + motion[DAMPING]
        state.total[n] = f_a - force
        state.undamped[n] = f_a - motion[ELASTIC]
        _book(model, state, f_a)
        if body[XI] > 0.0:
            _end_impact(model, state, n, present)
            _fly(model, state)
        else:
            _touch(model, state, n + 1)
    else:
        _fly(model, state)
    body[F_C] = force
    body[F_A] = f_a
    counts[STEP] = present + 1
    return force
