"""Two more schemes of second order on the modal equations of an uncontrolled, undamped impact.

Both start at rest at the first touch (gap zero) and take the plate's answer to a force exactly as
the modes give it. A mode is z = q'/w + i q, its weight at the struck point included, and turns by
e^(iwh) a step. Every run writes the gap at the end of every `every`-th step into `gaps`.
"""

import math

from jit import kernel
from studies.speed_accuracy.integrator_kernels import GRAVITY, hertz


@kernel(inline=True)
def _root_slope(stiffness, gap):
    """Slope of psi = sqrt(2 V), V = 2/5 s p^(5/2), by the gap."""
    return -1.25 * math.sqrt(0.8 * stiffness * math.sqrt(max(-gap, 0.0)))


@kernel(fused=True, reordered=True)
def _turn(z, table, force):
    """Fold the force of the last step in and propagate by one; displacement at the point."""
    x = 0.0
    for i in range(z.shape[1]):
        a = z[0, i] - table[2, i] * force
        b = z[1, i] - table[3, i] * force
        c = table[0, i] * a - table[1, i] * b
        d = table[0, i] * b + table[1, i] * a
        z[0, i] = c
        z[1, i] = d
        x += d
    return x


@kernel
def quadratised(z, body, table, gain, stiffness, mass, h, every, gaps):
    """Non-iterative contact by a quadratised potential (Ducceschi and Bilbao 2019).

    V = psi^2/2 with psi a state of its own: psi_1 = psi_0 + g (xi_1 - xi_0), F = -g (psi_0 +
    psi_1)/2, and g = dpsi/dxi half-way to the gap without force. With xi_1 = xi_free + gain F the
    force is the solution of one linear equation. What is kept to rounding is the energy with
    psi^2/2 in place of the contact's; psi itself drifts from sqrt(2 V).

    z: (2, modes); table: (4, modes), turn and change of z by a unit force over a step; body: sphere
    displacement and velocity, gap, psi.
    """
    force = 0.0
    for k in range(every * gaps.size):
        free = body[0] + h * (body[1] - 0.5 * h * GRAVITY) - _turn(z, table, force)
        way = free - body[2]
        slope = _root_slope(stiffness, body[2] + 0.5 * way)
        force = -slope * (body[3] + 0.5 * slope * way) / (1.0 + 0.5 * slope * slope * gain)
        gap = free + gain * force
        body[3] += slope * (gap - body[2])
        body[0] += h * (body[1] + 0.5 * h * (force / mass - GRAVITY))
        body[1] += h * (force / mass - GRAVITY)
        body[2] = gap
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = gap
    for i in range(z.shape[1]):
        z[0, i] -= table[2, i] * force
        z[1, i] -= table[3, i] * force


@kernel(fused=True, reordered=True)
def _weighed(kernel, force, count, offset):
    total = 0.0
    for j in range(count):
        total += kernel[offset + j] * force[j]
    return total


@kernel
def convolution(response, force, speed, stiffness, h, every, gaps):
    """Gap as a direct sum over all past forces, by the trapezoidal rule.

    response: gap per impulse on it, sphere and plate together, at (n - 1) h ... h, 0, shape (n,)
    with n = steps + 1, so that every sum runs forward; it is zero at 0, so the newest force needs
    no equation. force: out, shape (n,), N. Work grows with the square of the steps.
    """
    n = response.size
    force[0] = 0.0
    for k in range(1, n):
        t = k * h
        gap = -t * (speed + 0.5 * GRAVITY * t)
        gap += h * _weighed(response, force, k, n - 1 - k)  # force[0] is zero: no half weight
        force[k] = hertz(stiffness, gap)
        if k % every == 0:
            gaps[k // every - 1] = gap


@kernel
def sampled_response(omega, drive, mass, h, response):
    """The convolution's response at (n - 1) h ... 0 into `response`, m/(N s)."""
    n = response.size
    for k in range(n):
        response[n - 1 - k] = k * h / mass
    for i in range(omega.size):
        c, s = math.cos(omega[i] * h), math.sin(omega[i] * h)
        x, y = 1.0, 0.0
        share = drive[i] / omega[i]
        for k in range(n):
            response[n - 1 - k] += share * y
            x, y = c * x - s * y, c * y + s * x


@kernel
def state_after(omega, drive, force, h, mass, speed, y):
    """State at the end of `convolution`: y = (q, q', x_s, v_s), by the same trapezoidal rule."""
    n, modes = force.size, omega.size
    for i in range(modes):
        c, s = math.cos(omega[i] * h), math.sin(omega[i] * h)
        re, im = 0.0, 0.0
        for k in range(n):
            weight = 0.5 if k == n - 1 else 1.0
            re, im = c * re - s * im + weight * force[k], c * im + s * re
        y[i] = -h * drive[i] / omega[i] * im
        y[modes + i] = -h * drive[i] * re
    t = (n - 1) * h
    y[2 * modes] = -t * (speed + 0.5 * GRAVITY * t)
    y[2 * modes + 1] = -speed - GRAVITY * t
    for k in range(n):
        weight = 0.5 if k == n - 1 else 1.0
        y[2 * modes] += h * (n - 1 - k) * h * force[k] / mass
        y[2 * modes + 1] += h * weight * force[k] / mass
