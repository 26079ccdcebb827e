"""exp, log, sine and cosine with the same bits on every processor and under every C library.

Those of `math` and NumPy come from the C library or from vector code, which round the last bit
as the processor has fused multiply-adds or not. Here all is made of +, -, * and /, which IEEE 754
rounds alike everywhere. Results differ from those of `math` by at most two units in the last place,
sines and cosines by 2e-16. Their polynomials are those of fdlibm (Sun Microsystems 1993).

    exp(0.5) -> 1.6487212707001282
    sine_and_cosine_of_pi(0.5) -> (1.0, -0.0)
"""

import math

from hertzloop.common.jit import kernel

_LN2 = math.log(2.0)
# Leading bits of ln 2 and of pi/2, so few that a whole number times them is exact, and the rest.
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_HALF_PI_HIGH, _HALF_PI_MIDDLE = 1.57079632673412561417e00, 6.07710050630396597660e-11
_HALF_PI_LOW = 2.02226624879595063154e-21
_MOST_EXPONENT = 1100


@kernel(inline=True)
def exp(x):
    """e^x of a number, inf where that is too large."""
    if not abs(x) < 2.0 * _MOST_EXPONENT * _LN2:
        return x if x > 0.0 or math.isnan(x) else 0.0
    whole = math.floor(x / _LN2 + 0.5)
    r = (x - whole * _LN2_HIGH) - whole * _LN2_LOW
    total = 1.0
    for n in range(13, 0, -1):
        total = 1.0 + r * total / n
    return math.ldexp(total, whole)


@kernel(inline=True)
def expm1(x):
    """e^x - 1, to rounding also near zero."""
    if not abs(x) < 0.5:
        return exp(x) - 1.0
    total = 1.0
    for n in range(16, 1, -1):
        total = 1.0 + x * total / n
    return x * total


@kernel(inline=True)
def log(x):
    """Natural logarithm of a number above zero."""
    mantissa, exponent = math.frexp(x)
    if mantissa < 0.7071067811865476:
        mantissa, exponent = 2.0 * mantissa, exponent - 1
    s = (mantissa - 1.0) / (mantissa + 1.0)
    square, total = s * s, 0.0
    for n in range(21, 1, -2):
        total = square * (1.0 / n + total)
    return exponent * _LN2_HIGH + (2.0 * s + (2.0 * s * total + exponent * _LN2_LOW))


@kernel(inline=True)
def _turned(quarters, r):
    """Sine and cosine of `quarters` right angles and r, |r| <= pi/4."""
    z = r * r
    tail = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    tail = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * tail)
    sine = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * tail))
    tail = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11
    tail = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * tail)
    tail = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * tail))
    rest = 1.0 - 0.5 * z
    cosine = rest + (((1.0 - rest) - 0.5 * z) + z * tail)
    turn = quarters % 4
    if turn == 0:
        return sine, cosine
    if turn == 1:
        return cosine, -sine
    if turn == 2:
        return -sine, -cosine
    return -cosine, sine


@kernel(inline=True)
def sine_and_cosine(x):
    """Sine and cosine of an angle up to 1e6 either way, rad."""
    quarters = math.floor(x / (0.5 * math.pi) + 0.5)
    r = (x - quarters * _HALF_PI_HIGH) - quarters * _HALF_PI_MIDDLE
    return _turned(quarters, r - quarters * _HALF_PI_LOW)


@kernel(inline=True)
def sine_and_cosine_of_pi(x):
    """Sine and cosine of pi x; exact where x is a multiple of a half."""
    quarters = math.floor(2.0 * x + 0.5)
    return _turned(quarters, math.pi * (x - 0.5 * quarters))


@kernel
def fill_sines(share, found):
    """Write sin(n pi share), n = 1, 2, ..., into `found`."""
    for i in range(found.size):
        found[i] = sine_and_cosine_of_pi((i + 1) * share)[0]
