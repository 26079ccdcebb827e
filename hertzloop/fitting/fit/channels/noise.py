"""Noise of a record: its colour, and what a converter hides of it."""

import math

import numpy as np
import scipy

_AR_MOST = 8  # highest order of such a model
_AR_P = 1e-5  # probability of white noise below which the noise counts as coloured
_LAGS = 10  # of the test of a residual


def noise_below_converter_step(readings: np.ndarray, step: float) -> tuple[float, int]:
    """Noise of readings away from the baseline, where a converter hides most of it.

    The readings before the impact rest on one level or change between two, whichever the baseline
    is near. The noise before the converter follows from the share of each level; every baseline
    and every noise up to a step is equally probable before.

    Returns:
        Standard deviation with that of the converter, and how many samples would show it as well.
    """
    levels = np.round((readings - readings[0]) / step).astype(int)
    values, counts = np.unique(levels, return_counts=True)
    values = values - values[np.argmax(counts)]
    sigma = np.linspace(0.01, 1.0, 100)[:, np.newaxis, np.newaxis]
    mean = np.linspace(-1.0, 1.0, 161)[:, np.newaxis]
    upper, lower = (scipy.special.ndtr((values + half - mean) / sigma) for half in (0.5, -0.5))
    likely = np.sum(counts * np.log(np.maximum(upper - lower, 1e-300)), axis=-1)
    weight = np.exp(likely - np.max(likely)).sum(axis=1)
    variance = sigma[:, 0, 0] ** 2 + 1.0 / 12.0
    found = float(np.average(variance, weights=weight))
    spread = float(np.average((variance - found) ** 2, weights=weight))
    equivalent_samples = 2.0 * found**2 / max(spread, 1e-12)
    return step * math.sqrt(found), int(min(len(readings), equivalent_samples))


def autoregressive_noise(before: np.ndarray) -> tuple[np.ndarray, float]:
    """Autoregressive coefficients of noise that is not white; none of white noise.

    Returns:
        Coefficients, shape (order,), and the driving noise over the noise.
    """
    if ljung_box(before) >= _AR_P:
        return np.empty(0), 1.0
    n = len(before)
    lags = np.array([np.dot(before[: n - k], before[k:]) / n for k in range(_AR_MOST + 1)])
    best: tuple[float, np.ndarray, float] = (math.inf, np.empty(0), 1.0)
    for order in range(1, _AR_MOST + 1):
        phi = scipy.linalg.solve_toeplitz(lags[:order], lags[1 : order + 1])
        share = max(1.0 - float(phi @ lags[1 : order + 1]) / lags[0], 1e-6)
        score = n * math.log(share) + math.log(n) * order
        if score < best[0]:
            best = (score, phi, math.sqrt(share))
    return best[1], best[2]


def ljung_box(residual: np.ndarray, whitened_by: int = 0) -> float:
    """Return the probability that white noise has correlations as large as a residual's, at ten
    lags.

    Args:
        residual: shape (samples,).
        whitened_by: how many other samples the colour of the noise was found from; their errors
            leave correlations of their own. Zero of noise that needed no whitening.

    Source: Ljung and Box 1978, Biometrika 65, 297.
    """
    n = len(residual)
    if n <= 2 * _LAGS:
        return 1.0
    r = residual - np.mean(residual)
    power = float(r @ r)
    if power == 0.0:
        return 1.0
    rho = np.array([float(r[:-k] @ r[k:]) / power for k in range(1, _LAGS + 1)])
    q = n * (n + 2) * float(np.sum(rho * rho / (n - np.arange(1, _LAGS + 1))))
    if whitened_by:
        q /= 1.0 + n / whitened_by
    return float(scipy.stats.chi2.sf(q, _LAGS))
