"""The functions phi_k(x) = (e^x - sum_{i<k} x^i/i!)/x^k of exponential integrators."""

import math

import numpy as np

_SERIES_TERMS = 24  # 1/24! is below rounding for |x| <= 1


def phi(k: int, x: np.ndarray) -> np.ndarray:
    """phi_k of a complex array, k = 0, 1, 2, ...; to rounding also near zero, where the
    definition cancels; same shape."""
    if k == 0:
        return np.exp(x)
    large = np.abs(x) > 1.0
    safe = np.where(large, x, 1.0)
    direct = np.exp(safe) - sum(safe**i / math.factorial(i) for i in range(k))
    small = np.where(large, 0.0, x)
    series = np.zeros_like(small)
    for i in range(_SERIES_TERMS - 1, -1, -1):  # Horner's rule
        series = series * small + 1.0 / math.factorial(i + k)
    return np.asarray(np.where(large, direct / safe**k, series))
