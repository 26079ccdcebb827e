"""Compiled sums of a force over time at given frequencies."""

import numpy as np

from jit import kernel

_AT_ONCE = 128  # frequencies, so that their powers of a block stay in the processor's cache


@kernel(borrowed=True)
def nonzero(values):
    """First index of what is not zero, and the one after the last; 0, 0 where all is."""
    first, end = 0, values.size
    while first < end and values[first] == 0.0:
        first += 1
    while end > first and values[end - 1] == 0.0:
        end -= 1
    return (first, end) if first < end else (0, 0)


@kernel(released=True)
def add_spectrum(force, first, end, powers, delay, factor, found):
    """Add `factor` `delay` sum over `force[first:end]` of F_n z^n, z = exp(-i w h), to `found`.

    `powers`: real and imaginary part of z^n for n up to a block's length, shape (2, block + 1,
    frequencies). In blocks, by Horner's rule: from power to power one would lose digits.
    """
    block = powers.shape[1] - 1
    blocks = -(-(end - first) // block)
    real, imaginary = np.empty(_AT_ONCE), np.empty(_AT_ONCE)
    for low in range(0, found.size, _AT_ONCE):
        count = min(_AT_ONCE, found.size - low)
        re, im = real[:count], imaginary[:count]
        re[:] = 0.0
        im[:] = 0.0
        turn_re, turn_im = powers[0, block, low : low + count], powers[1, block, low : low + count]
        for b in range(blocks - 1, -1, -1):
            for j in range(count):
                turned = re[j] * turn_re[j] - im[j] * turn_im[j]
                im[j] = re[j] * turn_im[j] + im[j] * turn_re[j]
                re[j] = turned
            start = first + b * block
            for n in range(min(block, end - start)):
                f = force[start + n]
                if f == 0.0:
                    continue
                power_re, power_im = (
                    powers[0, n, low : low + count],
                    powers[1, n, low : low + count],
                )
                for j in range(count):
                    re[j] += f * power_re[j]
                    im[j] += f * power_im[j]
        for j in range(count):
            at = low + j
            found[at] += factor[at] * (delay[at] * complex(re[j], im[j]))
