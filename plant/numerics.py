"""The functions of exponential integrators."""

import math
from functools import cache

import numpy as np

from hertzloop.common.jit import kernel

_SERIES_TERMS = 24  # 1/24! is below rounding for |x| <= 1
_BLOCK = 256  # numbers that are followed together, in the processor's nearest memory
RIGID_RAD_S = 1e-9  # after 20 s the displacement is wrong by 7e-17


@kernel
def series(x_re, x_im, terms, re, im):
    """Sum of terms[i] x^i by Horner's rule for complex x, shape (numbers,), into `re` and `im`."""
    for first in range(0, re.size, _BLOCK):
        end = min(first + _BLOCK, re.size)
        # Parts, whose indices need no second look: that is what lets vectors be formed.
        a, b, u, v = x_re[first:end], x_im[first:end], re[first:end], im[first:end]
        for i in range(u.size):
            u[i], v[i] = terms[-1], 0.0
        for at in range(terms.size - 2, -1, -1):
            term = terms[at]
            for i in range(u.size):
                u[i], v[i] = u[i] * a[i] - v[i] * b[i] + term, u[i] * b[i] + v[i] * a[i]


def damped_frequency(
    omega: np.ndarray, eta: float | np.ndarray
) -> tuple[np.ndarray, float | np.ndarray]:
    """Theta of every oscillator (rad/s), and delta/Theta: one number, or one for every oscillator.

    A rigid body's mode takes a frequency so low that within any run it turns by less than
    rounding can show.
    """
    omega = np.maximum(omega, RIGID_RAD_S)
    if isinstance(eta, np.ndarray):
        root = np.sqrt(1.0 - eta * eta / 4.0)
        return omega * root, (eta / 2.0) / root
    one_root = math.sqrt(1.0 - eta * eta / 4.0)
    return omega * one_root, (eta / 2.0) / one_root


@cache
def _terms(k: int) -> np.ndarray:
    """1/(i + k)!, of the series' terms."""
    return np.array([1.0 / math.factorial(i + k) for i in range(_SERIES_TERMS)])


def phi(k: int, x: np.ndarray) -> np.ndarray:
    """phi_k of a complex array, k = 0, 1, 2, ...; to rounding also near zero, where the
    definition cancels; same shape."""
    if k == 0:
        return np.exp(x)
    large = np.abs(x) > 1.0
    found, near = np.empty(x.shape, complex), x[~large]
    of_near = np.empty(len(near), complex)
    parts = np.empty((2, len(near)))
    series(near.real.copy(), near.imag.copy(), _terms(k), *parts)
    of_near.real, of_near.imag = parts
    found[~large] = of_near
    if len(near) < x.size:
        far = x[large]
        direct = np.exp(far) - sum(far**i / math.factorial(i) for i in range(k))
        found[large] = direct / far**k
    return found
