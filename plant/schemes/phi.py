"""The functions phi_k(x) = (e^x - sum_{i<k} x^i/i!)/x^k of exponential integrators."""

import math
from functools import cache

import numpy as np

from plant.schemes.phi_kernels import series

_SERIES_TERMS = 24  # 1/24! is below rounding for |x| <= 1


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
