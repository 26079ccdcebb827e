"""Compiled sums over poles, and Aberth's method for the zeros of 1 + L.

Complex numbers are passed as pairs of real arrays, which the compiler turns into vector code.
"""

import math

from hertzloop.jit import kernel


@kernel(borrowed=True, fused=True, reordered=True, released=True)
def pole_sums(z_re, z_im, p_re, p_im, r_re, r_im, value, slope):
    """Add sum of r/(z - p) to `value`, shape (2, points), and its derivative to `slope`."""
    for i in range(z_re.size):
        x, y = z_re[i], z_im[i]
        a = b = c = d = 0.0
        for j in range(p_re.size):
            dx, dy = x - p_re[j], y - p_im[j]
            q = 1.0 / (dx * dx + dy * dy)
            w, v = dx * q, -dy * q
            t, u = r_re[j] * w - r_im[j] * v, r_re[j] * v + r_im[j] * w
            a += t
            b += u
            c += t * w - u * v
            d += t * v + u * w
        value[0, i] += a
        value[1, i] += b
        slope[0, i] -= c
        slope[1, i] -= d


@kernel(borrowed=True, fused=True, reordered=True)
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


@kernel(released=True)
def shifts(at, skip_plant, skip_law, plant, law, fir, direct, delay, found):
    """Write how far a pole of the open loop moves when the loop is closed, to first order.

    Args:
        at: the poles, complex, shape (n,).
        skip_plant, skip_law: which pole of the plant or of the law each of them is, else -1.
        plant, law: poles and residues as rows re, im, re, im, shape (4, poles).
        fir: coefficients of 1/Z and 1/Z^2 of the plant.
        direct: direct term of the law.
        delay: samples.
        found: shifts, complex, shape (n,).
    """
    for i in range(at.size):
        z = at[i]
        p = _row(z.real, z.imag, plant[0], plant[1], plant[2], plant[3], skip_plant[i])[0]
        near = _over(1.0 + 0.0j, z)
        p += near * (fir[0] + fir[1] * near)
        c = direct + _row(z.real, z.imag, law[0], law[1], law[2], law[3], skip_law[i])[0]
        turn = -_over(1.0 + 0.0j, z**delay)
        if skip_plant[i] >= 0:
            residue = complex(plant[2, skip_plant[i]], plant[3, skip_plant[i]])
            found[i] = _over(-turn * c * residue, 1.0 + turn * c * p)
        else:
            residue = complex(law[2, skip_law[i]], law[3, skip_law[i]])
            found[i] = _over(-turn * residue * p, 1.0 + turn * c * p)


@kernel(released=True)
def aberth_round(z_re, z_im, plant, law, fir, direct, delay, taps, done):
    """Move every zero that is not `done` by one step of Aberth's method; returns how many are left.

    Args:
        z_re, z_im: zeros, changed in place, shape (n,).
        plant, law, fir, direct, delay: as of `shifts`.
        taps: poles at zero of the plant.
        done: whether a zero has converged, shape (n,).
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
        c += direct
        relative = _over(c_1, c) + _over(p_1, p) - delay * near  # L'/L
        other = -_over(z**delay, c * p)  # 1/L, which does not overflow inside the circle
        slope = _over(relative, 1.0 + other) + by_plant + by_law + (delay + taps) * near
        around = _row(x, y, z_re, z_im, z_re, z_im, i)[2]
        change = _over(1.0 + 0.0j, slope - around)
        size = abs(change)
        if not math.isfinite(size):
            done[i] = True  # on a pole to the last digit
            continue
        z_re[i] -= change.real
        z_im[i] -= change.imag
        if size <= 1e-15 * max(abs(z), 1.0):
            done[i] = True
        else:
            left += 1
    return left
