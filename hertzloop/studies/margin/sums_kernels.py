"""Compiled sums over poles, for the response of a plant and for its closed-loop poles."""

from hertzloop.common.jit import kernel


@kernel(fastmath={"contract", "reassoc"})
def pole_sums(z_re, z_im, p_re, p_im, r_re, r_im, skip, found):
    """Write the sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) over the poles p, at points z.

    Complex numbers are pairs of real arrays, which the compiler turns into vector code.

    Args:
        z_re, z_im: points, shape (n,).
        p_re, p_im, r_re, r_im: poles and residues, shape (poles,).
        skip: number of the pole that a point leaves out, else -1, shape (n,).
        found: the three sums, each with real and imaginary part, shape (6, n).
    """
    for i in range(z_re.size):
        x, y, own = z_re[i], z_im[i], skip[i]
        a = b = c = d = e = f = 0.0
        for j in range(p_re.size):
            dx, dy = x - p_re[j], y - p_im[j]
            q = 0.0 if j == own else 1.0 / (dx * dx + dy * dy)
            w, v = dx * q, -dy * q
            t, u = r_re[j] * w - r_im[j] * v, r_re[j] * v + r_im[j] * w
            a += t
            b += u
            c -= t * w - u * v
            d -= t * v + u * w
            e += w
            f += v
        found[0, i] = a
        found[1, i] = b
        found[2, i] = c
        found[3, i] = d
        found[4, i] = e
        found[5, i] = f
