"""What records know of the keys: covariance, combinations, and draws through a converter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.problem import FitProblem
from hertzloop.identification.fit.verdicts import NO_BOUND, NORMAL

_NULL = 1e-10  # of the largest singular value
_DRAWS = 300
# Of intervals of a model with an error, which is not as random as a process: the factor on their
# width, and the error of the model's time over that of its size. Both were chosen with
# `python -m benchmarks.fit_discrepancy`.
_WIDER, _STRETCH = 2.0, 0.3
_SHOWN = 0.05  # exponents of a combination below this are left away


@dataclass(frozen=True)
class KeyCombination:
    """A product of keys: exponents by key, and its 95 % half-width, %; inf if nothing is known."""

    exponents: dict[str, float]
    half_width_percent: float

    def __str__(self) -> str:
        parts = []
        for key, power in self.exponents.items():
            parts.append(key if abs(power - 1.0) < 5e-3 else f"{key}^{power:.2g}")
        return " * ".join(parts)


@dataclass
class KeyUncertainty:
    """What the samples know of the keys' logarithms.

    Attributes:
        covariance: (keys, keys), inf where nothing is known.
        alone: standard deviation of each key if all other keys were known, (keys,).
        combinations: products of keys, from the worst known to the best.
        wider: factor on intervals that an error of the model brings.
    """

    covariance: np.ndarray
    alone: np.ndarray
    combinations: list[KeyCombination]
    wider: float = 1.0

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the logarithms, (keys,)."""
        return np.sqrt(np.diag(self.covariance))

    def half_widths(self) -> np.ndarray:
        """Return relative 95 % half-widths, (keys,)."""
        with np.errstate(over="ignore"):
            return np.asarray(np.expm1(np.minimum(NORMAL * self.sd, 700.0)))


def key_uncertainty(
    problem: FitProblem, iterate: Iterate, moved: Sequence[np.ndarray] = ()
) -> KeyUncertainty:
    """Return the covariance of the keys with all nuisances free.

    The columns of the Jacobian are scaled to length one first, and no direction is cut off: an
    unscaled pseudo-inverse would call the least known direction the best known one.

    Args:
        problem: the fit.
        iterate: where, with its Jacobian.
        moved: errors of the keys' logarithms that parts of the records show, (keys,) each.
    """
    keys = [f.key for f in problem.varied_keys]
    n = len(keys)
    jacobian = iterate.jacobian
    length = np.sqrt(np.sum(jacobian**2, axis=0))
    safe = np.where(length > 0.0, length, 1.0)
    scaled = jacobian / safe
    # Nuisances first: what is left of the keys' columns is what only the keys can explain.
    order = [*range(n, jacobian.shape[1]), *range(n)]
    r = np.asarray(np.linalg.qr(scaled[:, order], mode="r"))
    rest = r[-n:, -n:] if n else np.empty((0, 0))
    alone_r = np.sqrt(np.sum(rest**2, axis=0)) * safe[:n]
    _, s, v = np.linalg.svd(rest)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.where(s > _NULL, 1.0 / np.maximum(s, 1e-300), np.inf)
        # Columns: change of the logarithms by a unit step.
        directions = np.asarray(v).T / safe[:n, np.newaxis]
        covariance = (directions * np.where(np.isfinite(spread), spread, 0.0) ** 2) @ directions.T
        for i, infinite in enumerate(~np.isfinite(spread)):
            if infinite:
                touched = np.abs(v[i]) > 1e-6
                covariance[touched, touched] = np.inf
        for j in range(n):
            if length[j] == 0.0:
                covariance[j, :] = covariance[:, j] = 0.0
                covariance[j, j] = np.inf
        alone = np.where(alone_r > 0.0, 1.0 / np.maximum(alone_r, 1e-300), np.inf)
    wider = _WIDER if problem.has_model_error else 1.0
    if wider > 1.0:
        covariance = wider**2 * (covariance + _covariance_by_shared_errors(problem, iterate))
        covariance += sum((np.outer(m, m) for m in moved), np.zeros((n, n)))
    return KeyUncertainty(covariance, wider * alone, _key_combinations(keys, covariance), wider)


def bootstrap_covariance(
    problem: FitProblem, iterate: Iterate, until_s: float
) -> np.ndarray | None:
    """Return the covariance of the keys' logarithms with errors of a converter drawn anew.

    A converter whose step is larger than the noise makes errors that are neither white nor
    independent. Records are drawn around the fit, sent through the converter, and fitted by one
    linear step each.

    Returns:
        Shape (keys, keys); None where no record needs it, or the model has an error that hides
        those of the converter.
    """
    needs = [c.step > 0.0 and c.noise < 1.5 * c.step for c in problem.channels]
    n = len(problem.varied_keys)
    if not any(needs) or n == 0 or problem.has_model_error:
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
    for index, c in enumerate(problem.channels):
        predicted = problem.predict(iterate.x, index, until_s)
        by = problem.derivatives(iterate.x, index, until_s, predicted)  # Rows are not whitened.
        parts.append((predicted.reading, by, c.kept & (predicted.tau <= until_s)))
    errors = np.empty((_DRAWS, n))
    for draw in range(_DRAWS):
        moved = generator.standard_normal(len(sd)) * np.minimum(sd, 0.3) * 2.0
        rows = []
        for c, (model, by, used) in zip(problem.channels, parts, strict=True):
            true = model + by @ moved
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


def _covariance_by_shared_errors(problem: FitProblem, iterate: Iterate) -> np.ndarray:
    """Covariance of the keys' logarithms by errors of the model that a whole record shares: of its
    size and of its time, each as large as the prior of a gain or of a clock lets it act."""
    n = len(problem.varied_keys)
    found = np.zeros((n, n))
    sds: dict[int, float] = {}
    for c, indices in zip(problem.channels, problem.nuisance_indices, strict=True):
        share = 0.0 if c.discrepancy is None else c.discrepancy.overall
        for at, sd in ((indices.gain, share), (indices.clock, 1e6 * _STRETCH * share)):
            sds[at] = max(sds.get(at, 0.0), sd)
    if not any(sds.values()):
        return found
    inverse = iterate.pseudo_inverse(_NULL)
    for at, sd in sds.items():
        moved = sd * (inverse[:n, iterate.prior_rows] @ iterate.jacobian[iterate.prior_rows, at])
        found += np.outer(moved, moved)
    return found


def _key_combinations(keys: list[str], covariance: np.ndarray) -> list[KeyCombination]:
    """The principal directions of the logarithms: the worst known product of keys first."""
    if len(keys) < 2 or not np.all(np.isfinite(covariance)):
        return [
            KeyCombination({key: 1.0}, math.inf)
            for key, value in zip(keys, np.diag(covariance), strict=True)
            if not math.isfinite(value)
        ]
    values, vectors = np.linalg.eigh(covariance)
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        largest = vector[np.argmax(np.abs(vector))]
        powers = {
            key: float(power / largest)
            for key, power in zip(keys, vector, strict=True)
            if abs(power / largest) >= _SHOWN
        }
        # The product with these exponents changes by |exponents|^2 along the direction.
        length = math.sqrt(sum(p * p for p in powers.values()))
        sd = math.sqrt(max(float(value), 0.0)) * length
        wide = NORMAL * sd > NO_BOUND
        found.append(KeyCombination(powers, math.inf if wide else 100.0 * math.expm1(NORMAL * sd)))
    return found
