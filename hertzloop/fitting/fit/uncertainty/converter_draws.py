"""The uncertainty of keys where the steps of a converter are larger than the noise."""

import math

import numpy as np

from hertzloop.fitting.fit.key_combinations import key_combinations
from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.uncertainty.key_uncertainty import KeyUncertainty

_NULL = 1e-10  # of the largest singular value
_DRAWS = 300
_LEAST_DRAWN = 0.25  # of a variance


def apply_converter_draws(problem: FitProblem, iterate: Iterate, known: KeyUncertainty) -> None:
    """Use the covariance of draws; but never less than half the standard deviation that white noise
    of the same size would give."""
    drawn = _drawn_covariance(problem, iterate)
    if drawn is None:
        return
    least = float(np.max(np.diag(known.covariance) / np.diag(drawn)))
    if math.isfinite(least):
        known.covariance = drawn * max(1.0, _LEAST_DRAWN * least)
        known.combinations = key_combinations(
            [f.key for f in problem.varied_keys], known.covariance
        )


def _drawn_covariance(problem: FitProblem, iterate: Iterate) -> np.ndarray | None:
    """Return the covariance of the keys' logarithms with errors of a converter drawn anew.

    A converter whose step is larger than the noise makes errors that are neither white nor
    independent. Records are drawn around the fit, sent through the converter, and fitted by one
    linear step each.

    Returns:
        Shape (keys, keys); None where no record needs it, or the model has a discrepancy that
        hides the errors of the converter.
    """
    needs = [c.step > 0.0 and c.noise < 1.5 * c.step for c in problem.channels]
    n = len(problem.varied_keys)
    if not any(needs) or n == 0 or problem.has_discrepancy:
        return None
    length = np.sqrt(np.sum(iterate.jacobian**2, axis=0))
    length[length == 0.0] = 1.0
    scaled = iterate.jacobian / length
    inverse = np.linalg.pinv(scaled, rcond=_NULL)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) / length
    if np.any(sd[:n] > 0.3):
        return None
    generator = np.random.default_rng(0)
    parts = []
    for index, (c, one) in enumerate(zip(problem.channels, iterate.channels, strict=True)):
        predicted, until_s = one.predicted, iterate.until_s
        by = problem.derivatives(iterate.x, index, until_s, predicted)  # Rows are not whitened.
        parts.append((predicted.reading, by, c.kept & (predicted.tau <= until_s)))
    errors = np.empty((_DRAWS, n))
    for draw in range(_DRAWS):
        moved = generator.standard_normal(len(sd)) * np.minimum(sd, 0.3) * 2.0
        rows = []
        for c, (clean, by, used) in zip(problem.channels, parts, strict=True):
            true = clean + by @ moved
            quiet = math.sqrt(max(c.noise**2 - c.step**2 / 12.0, 0.0))
            read = true + quiet * generator.standard_normal(len(true))
            if c.step > 0.0:
                phase = generator.uniform() * c.step
                read = np.round((read - phase) / c.step) * c.step + phase
            error = np.where(used, read - true, 0.0)
            rows.append(c.whitened(error)[c.counted(used)])
        priors = generator.standard_normal(len(iterate.residual) - sum(len(r) for r in rows))
        errors[draw] = (inverse @ np.concatenate([*rows, priors]))[:n] / length[:n]
    return np.asarray(np.atleast_2d(np.cov(errors.T)))
