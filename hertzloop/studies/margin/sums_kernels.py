"""Compiled sums over poles, for the response of a plant and for its closed-loop poles."""

from hertzloop.common.jit import kernel

_TOGETHER = 64  # points whose sums stay in the processor's nearest memory


@kernel
def pole_sums(z_re, z_im, poles, residues, skip, found):
    """Write the sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) over the poles p, at points z.

    Vector code takes several points, not several poles at once, and real numbers: so every sum is
    added in the order of the poles.

    Args:
        z_re, z_im: points, shape (n,).
        poles, residues: complex, shape (poles,).
        skip: number of the pole that a point leaves out, else -1, shape (n,).
        found: the three sums, each with real and imaginary part, zeros before, shape (6, n).
    """
    for first in range(0, z_re.size, _TOGETHER):
        end = min(first + _TOGETHER, z_re.size)
        x, y, own = z_re[first:end], z_im[first:end], skip[first:end]
        a, b, c = found[0][first:end], found[1][first:end], found[2][first:end]
        d, e, f = found[3][first:end], found[4][first:end], found[5][first:end]
        for j in range(poles.size):
            p, q, r, s = poles[j].real, poles[j].imag, residues[j].real, residues[j].imag
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
