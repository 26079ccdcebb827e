"""What records know of the keys: the covariance of their logarithms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem

_NULL = 1e-10  # of the largest singular value
# Of intervals of a model with a discrepancy, which is not as random as a process: the factor on
# their width, and the discrepancy of the model's time over that of its size. Both were chosen with
# `python -m benchmarks.fit_discrepancy`.
_WIDER, _STRETCH = 2.0, 0.3


@dataclass
class KeyUncertainty:
    """What the samples know of the keys' logarithms.

    Attributes:
        covariance: (keys, keys), inf where nothing is known.
        alone: standard deviation of each key if all other keys were known, (keys,).
        wider: factor on intervals that a discrepancy brings.
    """

    covariance: np.ndarray
    alone: np.ndarray
    wider: float = 1.0

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the logarithms, (keys,)."""
        return np.sqrt(np.diag(self.covariance))


def key_uncertainty(
    problem: FitProblem, iterate: Iterate, shifts: Sequence[np.ndarray] = ()
) -> KeyUncertainty:
    """Return the covariance of the keys with all nuisances free.

    The columns of the Jacobian are scaled to length one first, and no direction is cut off: an
    unscaled pseudo-inverse would call the least known direction the best known one.

    Args:
        problem: the fit.
        iterate: where, with its Jacobian.
        shifts: of the keys' logarithms that parts of the records show, (keys,) each.
    """
    n = len(problem.varied_keys)
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
    wider = _WIDER if problem.has_discrepancy else 1.0
    if wider > 1.0:
        covariance = wider**2 * (covariance + _covariance_by_shared_discrepancy(problem, iterate))
        covariance += sum((np.outer(m, m) for m in shifts), np.zeros((n, n)))
    return KeyUncertainty(covariance, wider * alone, wider)


def _covariance_by_shared_discrepancy(problem: FitProblem, iterate: Iterate) -> np.ndarray:
    """Covariance of the keys' logarithms by a discrepancy that a whole record shares: of its
    size and of its time, each limited by the prior of a gain or of a clock."""
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
