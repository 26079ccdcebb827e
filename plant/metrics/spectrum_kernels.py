"""Spectra of forces at the frequencies of oscillators, and what they drive."""

from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

_AT_ONCE = 128  # frequencies, so that their powers of a block stay in the processor's cache


@kernel
def nonzero(values):
    """First index of what is not zero, and the one after the last; 0, 0 where all is."""
    first, end = 0, values.size
    while first < end and values[first] == 0.0:
        first += 1
    while end > first and values[end - 1] == 0.0:
        end -= 1
    return (first, end) if first < end else (0, 0)


class Spectra(NamedTuple):
    """What sums of samples become at the frequencies of oscillators.

    `powers`: real and imaginary part of z^n, z = exp(-i w h), for n up to a block's length, shape
    (2, block + 1, frequencies). Shapes (frequencies,): `held`, `tilted`: spectra of a mean of 1 and
    of a slope of 1 over a step; `contact`, `actuator`: values of the modes there.
    """

    powers: np.ndarray
    held: np.ndarray
    tilted: np.ndarray
    contact: np.ndarray
    actuator: np.ndarray


@kernel(allocates=True)
def add_spectrum(force, sign, powers, factor, found):
    """Add `factor` times the sum of `sign` F_n z^n to `found`; `powers` as in Spectra.

    In blocks, by Horner's rule: from power to power one would lose digits.
    """
    end = nonzero(force)[1]
    block = powers.shape[1] - 1
    blocks = -(-end // block)
    real, imaginary = np.empty(_AT_ONCE), np.empty(_AT_ONCE)
    for low in range(0, found.size if end else 0, _AT_ONCE):
        count = min(_AT_ONCE, found.size - low)
        re, im = real[:count], imaginary[:count]
        for j in range(count):
            re[j] = im[j] = 0.0
        turn_re, turn_im = powers[0, block, low : low + count], powers[1, block, low : low + count]
        for b in range(blocks - 1, -1, -1):
            for j in range(count):
                turned = re[j] * turn_re[j] - im[j] * turn_im[j]
                im[j] = re[j] * turn_im[j] + im[j] * turn_re[j]
                re[j] = turned
            start = b * block
            for n in range(min(block, end - start)):
                f = sign * force[start + n]
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
            found[low + j] += factor[low + j] * complex(re[j], im[j])


@kernel(allocates=True)
def drive(contact_n, slope_n, sign, actuator_n, actuator_slope_n, by, found):
    """Phi_c F_c + Phi_a F_a of every oscillator into `found`; the contact's force is `sign` times
    what is given. See plant.metrics.noise.modal_drive."""
    part = np.zeros(found.size, np.complex128)
    add_spectrum(contact_n, sign, by.powers, by.held, part)
    add_spectrum(slope_n, sign, by.powers, by.tilted, part)
    for i in range(found.size):
        found[i] = by.contact[i] * part[i]
        part[i] = 0.0
    add_spectrum(actuator_n, 1.0, by.powers, by.held, part)
    add_spectrum(actuator_slope_n, 1.0, by.powers, by.tilted, part)
    for i in range(found.size):
        found[i] += by.actuator[i] * part[i]
