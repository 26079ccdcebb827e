"""Compiled sums over poles, for the response of a plant and for its closed-loop poles."""

from hertzloop.common.jit import kernel

_TOGETHER = 64  # points whose sums stay in the processor's nearest memory


@kernel
def pole_sums(z_re, z_im, p_re, p_im, r_re, r_im, skip, found):
    """Write the sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) over the poles p, at points z.

    Complex numbers are pairs of real arrays. Vector code takes several points, not several poles at
    once: so every sum is added in the order of the poles.

    Args:
        z_re, z_im: points, shape (n,).
        p_re, p_im, r_re, r_im: poles and residues, shape (poles,).
        skip: number of the pole that a point leaves out, else -1, shape (n,).
        found: the three sums, each with real and imaginary part, shape (6, n).
    """
    for first in range(0, z_re.size, _TOGETHER):
        end = min(first + _TOGETHER, z_re.size)
        x, y, own = z_re[first:end], z_im[first:end], skip[first:end]
        a, b, c = found[0][first:end], found[1][first:end], found[2][first:end]
        d, e, f = found[3][first:end], found[4][first:end], found[5][first:end]
        for i in range(x.size):
            a[i] = b[i] = c[i] = d[i] = e[i] = f[i] = 0.0
        for j in range(p_re.size):
            p, q, r, s = p_re[j], p_im[j], r_re[j], r_im[j]
            for i in range(x.size):
                dx, dy = x[i] - p, y[i] - q
                over = 1.0 / (dx * dx + dy * dy)
                if own[i] == j:
                    over = 0.0
                w, v = dx * over, -dy * over
                t, u = r * w - s * v, r * v + s * w
                a[i] += t
                b[i] += u
                c[i] -= t * w - u * v
                d[i] -= t * v + u * w
                e[i] += w
                f[i] += v
