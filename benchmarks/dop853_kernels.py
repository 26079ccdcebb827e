"""A compiled DOP853 on the modal equations of an uncontrolled, undamped impact.

Coefficients, error estimate, step control and dense output are Hairer's as in
`scipy.integrate.DOP853` (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I,
2nd ed., II.5, II.6, II.10), from which the coefficients are imported. Three things, exact but
for rounding, make it as fast as this problem allows:

- The equations are of second order, so the velocities of the stages are eliminated: with
  a_i the accelerations, q_i = q + c_i h v + h^2 sum_j (A A)_ij a_j.
- a_j = -w^2 q_j - d F_j: the displacements of the stages are stored, and what the force adds is
  one number a stage, so that a stage is one pass over the modes.
- The dense output is that of the gap, which is linear in the state: numbers, not arrays.

y = (q, q', x_s, v_s) as in `benchmarks.integrator_kernels`.
"""

import math

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as _hairer

from benchmarks.integrator_kernels import GRAVITY, hertz
from hertzloop.common.jit import kernel

STAGES, EXTENDED = 12, 16
_C = np.ascontiguousarray(_hairer.C)
_A = np.ascontiguousarray(_hairer.A)
_AA = _A @ _A
_D = np.ascontiguousarray(_hairer.D)
# Rows of END: weights of the accelerations (without and with one more factor of h) in the velocity
# and displacement at the end and in both error estimates of each.
_b = np.append(_hairer.B, np.zeros(EXTENDED - STAGES))
_e3, _e5 = (np.append(e, np.zeros(EXTENDED - STAGES - 1)) for e in (_hairer.E3, _hairer.E5))
_V, _Q, _E3V, _E3Q, _E5V, _E5Q = range(6)
_END = np.ascontiguousarray([_b, _b @ _A, _e3, _e3 @ _A, _e5, _e5 @ _A])
_END[abs(_END) < 1e-13] = 0.0
_AA[abs(_AA) < 1e-13] = 0.0
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 10.0  # change of the step, as in SciPy
# Stages that the displacement of a stage takes up, padded with stage 0 of weight 0.
_WIDTH = 10
_TERMS = np.zeros((EXTENDED, _WIDTH), np.int64)
_WEIGHTS = np.zeros((EXTENDED, _WIDTH))
for _i in range(EXTENDED):
    _used = np.flatnonzero(_AA[_i])
    _TERMS[_i, : len(_used)] = _used
    _WEIGHTS[_i, : len(_used)] = _AA[_i, _used]
_USED = np.count_nonzero(_AA, axis=1)


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_3(q, v, omega2, drive, out, a, b, c, wa, wb, wc, t, push):
    """out = q + t v - omega2 (wa a + wb b + wc c) - push drive; its sum, and that of omega2 out."""
    x = 0.0
    f = 0.0
    for i in range(q.size):
        turned = wa * a[i] + wb * b[i] + wc * c[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_6(q, v, omega2, drive, out, a, b, c, d, e, g, w, t, push):
    """The same of six stages, weights `w`."""
    x = 0.0
    f = 0.0
    wa, wb, wc, wd, we, wg = w[0], w[1], w[2], w[3], w[4], w[5]
    for i in range(q.size):
        turned = wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i] + we * e[i] + wg * g[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_10(q, v, omega2, drive, out, k, w, t, push, terms):
    """The same of ten stages, rows `terms` of k."""
    x = 0.0
    f = 0.0
    a, b, c, d, e = k[terms[0]], k[terms[1]], k[terms[2]], k[terms[3]], k[terms[4]]
    g, p, m, n, o = k[terms[5]], k[terms[6]], k[terms[7]], k[terms[8]], k[terms[9]]
    w0, w1, w2, w3, w4 = w[0], w[1], w[2], w[3], w[4]
    w5, w6, w7, w8, w9 = w[5], w[6], w[7], w[8], w[9]
    for i in range(q.size):
        turned = w0 * a[i] + w1 * b[i] + w2 * c[i] + w3 * d[i] + w4 * e[i]
        turned += w5 * g[i] + w6 * p[i] + w7 * m[i] + w8 * n[i] + w9 * o[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(allocates=True)
def _stage(s, y_v, omega2, drive, k, h, force):
    """Stage `s` of the plate: sums of its displacements and of omega2 times them. `force`:
    contact forces of the stages so far, N."""
    push = 0.0
    for j in range(s):
        push += _AA[s, j] * force[j]
    push *= h * h
    terms = _TERMS[s]
    w = h * h * _WEIGHTS[s]
    t = _C[s] * h
    if _USED[s] <= 3:
        a, b, c = k[terms[0]], k[terms[1]], k[terms[2]]
        return _stage_3(k[0], y_v, omega2, drive, k[s], a, b, c, w[0], w[1], w[2], t, push)
    if _USED[s] <= 6:
        a, b, c, d, e, g = (
            k[terms[0]],
            k[terms[1]],
            k[terms[2]],
            k[terms[3]],
            k[terms[4]],
            k[terms[5]],
        )
        return _stage_6(k[0], y_v, omega2, drive, k[s], a, b, c, d, e, g, w, t, push)
    return _stage_10(k[0], y_v, omega2, drive, k[s], k, w, t, push, terms)


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _end(v, omega2, drive, k, v1, h, weights, push, rtol, atol):
    """State at the end of a step into k[12], v1. Sums of displacement, velocity and omega2
    times displacement, and of the squares of both weighed error estimates over h."""
    q, q1 = k[0], k[STAGES]
    a3, a4, a5, a6, a7 = k[3], k[4], k[5], k[6], k[7]
    a8, a9, a10, a11 = k[8], k[9], k[10], k[11]
    x = 0.0
    u = 0.0
    f = 0.0
    five = 0.0
    three = 0.0
    w = weights[_Q]
    q0, q5, q6, q7, q8, q9, q10 = w[0], w[5], w[6], w[7], w[8], w[9], w[10]
    by_force = push[_Q]
    for i in range(q.size):
        by_q = q0 * q[i] + q5 * a5[i] + q6 * a6[i] + q7 * a7[i] + q8 * a8[i]
        by_q += q9 * a9[i] + q10 * a10[i]
        q_new = q[i] + h * v[i] - h * h * (omega2[i] * by_q + drive[i] * by_force)
        q1[i] = q_new
        x += q_new
        f += omega2[i] * q_new
    w = weights[_V]
    v0, v5, v6, v7, v8, v9, v10, v11 = w[0], w[5], w[6], w[7], w[8], w[9], w[10], w[11]
    by_force = push[_V]
    for i in range(q.size):
        by_v = v0 * q[i] + v5 * a5[i] + v6 * a6[i] + v7 * a7[i] + v8 * a8[i]
        by_v += v9 * a9[i] + v10 * a10[i] + v11 * a11[i]
        v_new = v[i] - h * (omega2[i] * by_v + drive[i] * by_force)
        v1[i] = v_new
        u += v_new
    w, e = weights[_E5V], weights[_E3V]
    v0, v5, v6, v7, v8, v9, v10, v11 = w[0], w[5], w[6], w[7], w[8], w[9], w[10], w[11]
    s0, s5, s6, s7, s8, s9, s10, s11 = e[0], e[5], e[6], e[7], e[8], e[9], e[10], e[11]
    push_5, push_3 = push[_E5V], push[_E3V]
    for i in range(q.size):
        by_5 = v0 * q[i] + v5 * a5[i] + v6 * a6[i] + v7 * a7[i] + v8 * a8[i]
        by_5 += v9 * a9[i] + v10 * a10[i] + v11 * a11[i]
        by_3 = s0 * q[i] + s5 * a5[i] + s6 * a6[i] + s7 * a7[i] + s8 * a8[i]
        by_3 += s9 * a9[i] + s10 * a10[i] + s11 * a11[i]
        scale = 1.0 / (atol + rtol * max(abs(v[i]), abs(v1[i])))
        by_5 = (omega2[i] * by_5 + drive[i] * push_5) * scale
        by_3 = (omega2[i] * by_3 + drive[i] * push_3) * scale
        five += by_5 * by_5
        three += by_3 * by_3
    w, e = weights[_E5Q], weights[_E3Q]
    q0, q3, q4, q5, q6, q7, q8 = w[0], w[3], w[4], w[5], w[6], w[7], w[8]
    q9, q10 = w[9], w[10]
    r0, r3, r4, r5, r6, r7, r8 = e[0], e[3], e[4], e[5], e[6], e[7], e[8]
    r9, r10 = e[9], e[10]
    push_5, push_3 = push[_E5Q], push[_E3Q]
    for i in range(q.size):
        by_5 = q0 * q[i] + q3 * a3[i] + q4 * a4[i] + q5 * a5[i] + q6 * a6[i]
        by_5 += q7 * a7[i] + q8 * a8[i] + q9 * a9[i] + q10 * a10[i]
        by_3 = r0 * q[i] + r3 * a3[i] + r4 * a4[i] + r5 * a5[i] + r6 * a6[i]
        by_3 += r7 * a7[i] + r8 * a8[i] + r9 * a9[i] + r10 * a10[i]
        scale = h / (atol + rtol * max(abs(q[i]), abs(q1[i])))
        by_5 = (omega2[i] * by_5 + drive[i] * push_5) * scale
        by_3 = (omega2[i] * by_3 + drive[i] * push_3) * scale
        five += by_5 * by_5
        three += by_3 * by_3
    return x, u, f, five, three


@kernel(allocates=True)
def _interpolate(x, h, gap, gap_1, rates):
    """Gap at the part x of a step, from the gap at its ends and its rates at all stages."""
    change = gap_1 - gap
    y = 0.0
    for i in range(7):
        row = 3 - i
        if row >= 0:
            part = 0.0
            for j in range(EXTENDED):
                part += _D[row, j] * rates[j]
            part *= h
        elif row == -1:
            part = 2.0 * change - h * (rates[STAGES] + rates[0])
        elif row == -2:
            part = h * rates[0] - change
        else:
            part = change
        y += part
        y *= x if i % 2 == 0 else 1.0 - x
    return gap + y


@kernel(allocates=True)
def dop853(y, omega2, drive, stiffness, mass, every_s, gaps, rtol, atol, first_step_s, same_step):
    """Integrate over gaps.size times `every_s` s; gap at the end of each into `gaps` (m).

    `same_step`: keep the first step whatever the error, for tests of the order. Returns accepted
    and rejected steps and evaluations of the right-hand side; all -1 if the step vanishes.
    """
    n = omega2.size
    k = np.empty((EXTENDED, n))
    k[0] = y[:n]
    v, v1 = y[n : 2 * n].copy(), np.empty(n)
    force, sphere_a, gap_a = np.zeros(EXTENDED), np.zeros(EXTENDED), np.zeros(EXTENDED)
    rates, push = np.zeros(EXTENDED), np.zeros(6)
    moved = drive.sum()
    x_s, v_s = y[2 * n], y[2 * n + 1]
    gap = x_s - k[0].sum()
    rate = v_s - v.sum()
    bent = (omega2 * k[0]).sum()
    t, h, sample = 0.0, first_step_s, 0
    end = every_s * gaps.size
    accepted, rejected, evaluations = 0, 0, 1
    after_rejection = False
    while sample < gaps.size:
        last = t + h >= end * (1.0 - 1e-12)
        if last:
            h = end - t
        for s in range(EXTENDED - 3):
            if s == 0:
                gap_s = gap
            elif s < STAGES:
                plate, bent = _stage(s, v, omega2, drive, k, h, force)
                sphere = x_s + _C[s] * h * v_s
                for j in range(s):
                    sphere += h * h * _AA[s, j] * sphere_a[j]
                gap_s = sphere - plate
            else:
                for i in range(6):
                    push[i] = 0.0
                    for j in range(STAGES):
                        push[i] += _END[i, j] * force[j]
                plate, speed, bent, five, three = _end(
                    v, omega2, drive, k, v1, h, _END, push, rtol, atol
                )
                x_1, v_1 = x_s + h * v_s, v_s
                parts = np.zeros(4)
                for j in range(STAGES):
                    x_1 += h * h * _END[_Q, j] * sphere_a[j]
                    v_1 += h * _END[_V, j] * sphere_a[j]
                    for i in range(4):
                        parts[i] += _END[2 + i, j] * sphere_a[j]
                scale_v = atol + rtol * max(abs(v_s), abs(v_1))
                scale_q = (atol + rtol * max(abs(x_s), abs(x_1))) / h
                five += (parts[2] / scale_v) ** 2 + (parts[3] / scale_q) ** 2
                three += (parts[0] / scale_v) ** 2 + (parts[1] / scale_q) ** 2
                gap_s = x_1 - plate
            force[s] = hertz(stiffness, gap_s)
            sphere_a[s] = force[s] / mass - GRAVITY
            gap_a[s] = sphere_a[s] + bent + moved * force[s]
        evaluations += STAGES
        error = 0.0
        if five != 0.0 or three != 0.0:
            error = h * five / math.sqrt((five + 0.01 * three) * (2 * n + 2))
        if not (error < 1.0 or same_step):
            h *= max(_LEAST, _SAFETY * error**-0.125)
            rejected += 1
            after_rejection = True
            if not h > 1e-16 * end:
                return -1, -1, -1
            bent = gap_a[0] - sphere_a[0] - moved * force[0]
            continue
        if last or t + h >= every_s * (sample + 1):
            for s in range(STAGES + 1, EXTENDED):
                plate, bent_s = _stage(s, v, omega2, drive, k, h, force)
                sphere = x_s + _C[s] * h * v_s
                for j in range(s):
                    sphere += h * h * _AA[s, j] * sphere_a[j]
                force[s] = hertz(stiffness, sphere - plate)
                sphere_a[s] = force[s] / mass - GRAVITY
                gap_a[s] = sphere_a[s] + bent_s + moved * force[s]
            evaluations += EXTENDED - STAGES - 1
            for s in range(EXTENDED):
                rates[s] = rate
                for j in range(s):
                    rates[s] += h * _A[s, j] * gap_a[j]
            while sample < gaps.size and (last or every_s * (sample + 1) <= t + h):
                x = (every_s * (sample + 1) - t) / h
                gaps[sample] = _interpolate(x, h, gap, gap_s, rates)
                sample += 1
        t += h
        k[0] = k[STAGES]
        v, v1 = v1, v
        x_s, v_s, gap, rate = x_1, v_1, gap_s, v_1 - speed
        accepted += 1
        if not same_step:
            factor = min(_MOST, _SAFETY * error**-0.125) if error > 0.0 else _MOST
            h *= min(1.0, factor) if after_rejection else factor
        after_rejection = False
    y[:n], y[n : 2 * n] = k[0], v
    y[2 * n], y[2 * n + 1] = x_s, v_s
    return accepted, rejected, evaluations
