"""Compiled sums over poles, and Aberth's method for the zeros of 1 + L.

Complex numbers are passed as pairs of real arrays, which the compiler turns into vector code.
"""

import math

from hertzloop.common.jit import kernel


@kernel(fastmath={"contract", "reassoc"})
def far_sums(theta, first, last, poles, residues, count, value, slope):
    """Write, at the nodes of every box, the sum of r/(z - p) over the poles p far from it, and its
    derivative.

    Args:
        theta: angles of the nodes, shape (boxes, nodes).
        first, last: range of the near poles, shape (boxes,).
        poles, residues: three periods of poles by angle, shape (2, 3 count).
        count: poles in a period.
        value, slope: shape (2, boxes, nodes).
    """
    for box in range(theta.shape[0]):
        for i in range(theta.shape[1]):
            x, y = math.cos(theta[box, i]), math.sin(theta[box, i])
            a = b = c = d = 0.0
            for j in range(last[box], first[box] + count):
                dx, dy = x - poles[0, j], y - poles[1, j]
                q = 1.0 / (dx * dx + dy * dy)
                w, v = dx * q, -dy * q
                t = residues[0, j] * w - residues[1, j] * v
                u = residues[0, j] * v + residues[1, j] * w
                a += t
                b += u
                c += t * w - u * v
                d += t * v + u * w
            value[0, box, i] = a
            value[1, box, i] = b
            slope[0, box, i] = -c
            slope[1, box, i] = -d


@kernel(fastmath={"contract", "reassoc"})
def circle_sums(theta, box, edges, first, last, poles, residues, far, value, slope):
    """Write the sum of r/(z - p) over all poles, and its derivative, at points of the unit circle:
    near poles one by one, far ones by Chebyshev series.

    Args:
        theta, box: angles, and in which box each is, shape (points,).
        edges: of the boxes, shape (boxes + 1,).
        first, last, poles, residues: as of `far_sums`.
        far: coefficients of value and slope, real and imaginary, shape (4, boxes, terms).
        value, slope: shape (2, points).
    """
    for i in range(theta.size):
        n = box[i]
        low, high = edges[n], edges[n + 1]
        at = (2.0 * theta[i] - low - high) / (high - low)
        x, y = math.cos(theta[i]), math.sin(theta[i])
        a, b, c, d = far[0, n, 0], far[1, n, 0], far[2, n, 0], far[3, n, 0]
        before, now = 1.0, at
        for j in range(1, far.shape[2]):
            a += far[0, n, j] * now
            b += far[1, n, j] * now
            c += far[2, n, j] * now
            d += far[3, n, j] * now
            before, now = now, 2.0 * at * now - before
        for j in range(first[n], last[n]):
            dx, dy = x - poles[0, j], y - poles[1, j]
            q = 1.0 / (dx * dx + dy * dy)
            w, v = dx * q, -dy * q
            t = residues[0, j] * w - residues[1, j] * v
            u = residues[0, j] * v + residues[1, j] * w
            a += t
            b += u
            c -= t * w - u * v
            d -= t * v + u * w
        value[0, i] = a
        value[1, i] = b
        slope[0, i] = c
        slope[1, i] = d


@kernel(fastmath={"contract", "reassoc"})
def _row(x, y, p_re, p_im, r_re, r_im, skip):
    """Sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) at z = x + i y, without pole `skip`."""
    a = b = c = d = e = f = 0.0
    for j in range(p_re.size):
        dx, dy = x - p_re[j], y - p_im[j]
        q = 0.0 if j == skip else 1.0 / (dx * dx + dy * dy)
        w, v = dx * q, -dy * q
        t, u = r_re[j] * w - r_im[j] * v, r_re[j] * v + r_im[j] * w
        a += t
        b += u
        c -= t * w - u * v
        d -= t * v + u * w
        e += w
        f += v
    return complex(a, b), complex(c, d), complex(e, f)


@kernel(inline=True)
def _over(a, b):
    """a/b of complex numbers; not finite, instead of an exception, where b is zero."""
    size = b.real * b.real + b.imag * b.imag
    scale = 1.0 / size
    real = (a.real * b.real + a.imag * b.imag) * scale
    return complex(real, (a.imag * b.real - a.real * b.imag) * scale)


@kernel(inline=True)
def _power(z, n):
    """z^n, which stays finite."""
    size = math.hypot(z.real, z.imag)
    if size == 0.0:
        return complex(1.0 if n == 0 else 0.0, 0.0)
    size = math.exp(min(n * math.log(size), 300.0))
    angle = n * math.atan2(z.imag, z.real)
    return complex(size * math.cos(angle), size * math.sin(angle))


@kernel
def _powers(near, filters):
    """Sum of filters[k] near^k, near = 1/Z, and its derivative by Z."""
    value = complex(0.0, 0.0)
    slope = complex(0.0, 0.0)
    for i in range(filters.size - 1, -1, -1):
        slope = slope * near + value
        value = value * near + filters[i]
    return value, -slope * near * near


@kernel
def shifts(at, skip_plant, skip_law, plant, law, fir, filters, delay, found):
    """Write how far a pole of the open loop moves when the loop is closed, to first order.

    Args:
        at: the poles, complex, shape (n,).
        skip_plant, skip_law: which pole of the plant or of the law each of them is, else -1.
        plant, law: poles and residues as rows re, im, re, im, shape (4, poles).
        fir: coefficients of 1/Z and 1/Z^2 of the plant.
        filters: coefficients of 1, 1/Z, ... of the law.
        delay: samples.
        found: shifts, complex, shape (n,).
    """
    for i in range(at.size):
        z = at[i]
        p = _row(z.real, z.imag, plant[0], plant[1], plant[2], plant[3], skip_plant[i])[0]
        near = _over(1.0 + 0.0j, z)
        p += near * (fir[0] + fir[1] * near)
        c = (
            _powers(near, filters)[0]
            + _row(z.real, z.imag, law[0], law[1], law[2], law[3], skip_law[i])[0]
        )
        late = _power(z, delay)
        if skip_plant[i] >= 0:
            residue = complex(plant[2, skip_plant[i]], plant[3, skip_plant[i]])
            found[i] = _over(c * residue, late - c * p)
        else:
            residue = complex(law[2, skip_law[i]], law[3, skip_law[i]])
            found[i] = _over(residue * p, late - c * p)


@kernel
def aberth_round(z_re, z_im, plant, law, fir, filters, delay, late, done, tolerance):
    """Move every zero that is not `done` by one step of Aberth's method; returns how many are left.

    Args:
        z_re, z_im: zeros, changed in place, shape (n,).
        plant, law, fir, filters, delay: as of `shifts`.
        late: poles of the open loop at zero, those of the delay included.
        done: whether a zero has converged, shape (n,).
        tolerance: length of a last step.
    """
    left = 0
    for i in range(z_re.size):
        if done[i]:
            continue
        x, y = z_re[i], z_im[i]
        z = complex(x, y)
        p, p_1, by_plant = _row(x, y, plant[0], plant[1], plant[2], plant[3], -1)
        near = _over(1.0 + 0.0j, z)
        p += near * (fir[0] + fir[1] * near)
        p_1 -= near * near * (fir[0] + 2.0 * fir[1] * near)
        c, c_1, by_law = _row(x, y, law[0], law[1], law[2], law[3], -1)
        part, part_1 = _powers(near, filters)
        c += part
        c_1 += part_1
        relative = _over(c_1, c) + _over(p_1, p) - delay * near  # L'/L
        other = -_over(_power(z, delay), c * p)  # 1/L, which does not overflow inside the circle
        slope = _over(relative, 1.0 + other) + by_plant + by_law + late * near
        around = _row(x, y, z_re, z_im, z_re, z_im, i)[2]
        change = _over(1.0 + 0.0j, slope - around)
        size = abs(change)
        if not math.isfinite(size):
            done[i] = True  # on a pole to the last digit
            continue
        z_re[i] -= change.real
        z_im[i] -= change.imag
        if size <= tolerance:
            done[i] = True
        else:
            left += 1
    return left
