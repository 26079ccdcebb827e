"""Static flexibility of the higher modes of a simply supported plate."""

from hertzloop.common.jit import kernel


@kernel
def flexibility(along_x, along_y, sin_x, sin_y, speed, above, up_to):
    """Sum of (phi/w)^2 over all modes above a frequency and up to another, rad/s.

    `along_x`, `along_y`: squared wave numbers along the sides, rising (1/m^2); phi is the product
    of both sines at the point, w is `speed` times the sum of both squares.
    """
    total = 0.0
    for j in range(along_y.size):
        for i in range(along_x.size):
            omega = speed * (along_y[j] + along_x[i])
            if omega > up_to:
                break
            if omega > above:
                share = sin_x[i] * sin_y[j] / omega
                total += share * share
    return total
