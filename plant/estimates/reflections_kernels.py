"""Reflections of a force on a plate with mirror images, summed over the images.

Compiled, since SciPy, which has Si and Ci, would take a tenth of a run's start to import, and since
the sums are most of what a case of a sweep over plates waits for.
"""

import math

from hertzloop.common.jit import kernel

TERMS, FEWEST = 160.0, 6  # of a continued fraction: times u, and for a large u


@kernel(inline=True)
def sine_and_cosine_integral(u):
    """Si(u) and Ci(u), u > 0, by the continued fraction of E_1(iu) = i (Si(u) - pi/2) - Ci(u), to
    rounding; it takes about 160/u terms (Abramowitz and Stegun 1964, 5.1.22, 5.2.21 to 5.2.24)."""
    z = complex(0.0, u)
    rest = complex(0.0, 0.0)
    for n in range(int(TERMS / u) + FEWEST, 0, -1):
        rest = n * n / (z + (2 * n + 1) - rest)
    found = complex(math.cos(u), -math.sin(u)) / (z + 1.0 - rest)
    return 0.5 * math.pi + found.imag, -found.real


@kernel
def add_twice_integrated(t, r4a, weight, once, twice):
    """Add the first and second integral over time of weight (1 - (2/pi) Si(r4a/t)) at times `t` > 0
    (s), r4a = r^2/(4 a) in s."""
    for i in range(t.size):
        u = r4a / t[i]
        si, ci = sine_and_cosine_integral(u)
        sin, cos = math.sin(u), math.cos(u)
        now = 1.0 - 2.0 / math.pi * si
        cosines = t[i] * cos + r4a * (si - 0.5 * math.pi)  # integral of cos(r4a/t)
        sines = 0.5 * (t[i] * t[i] * sin + r4a * cosines)  # of t sin(r4a/t)
        once[i] += weight * (t[i] * now - 2.0 / math.pi * (t[i] * sin - r4a * ci))
        by_ramp = 0.5 * t[i] * t[i] * now - sines / math.pi
        by_ramp -= 2.0 / math.pi * (sines - r4a * (t[i] * ci + cosines))
        twice[i] += weight * by_ramp
