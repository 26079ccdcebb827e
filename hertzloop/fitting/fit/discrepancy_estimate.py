"""Estimate the discrepancies of the records of a fit, their correlation and unknown noises.

They maximise the restricted likelihood, from which keys and nuisances are integrated out (Patterson
and Thompson 1971, Biometrika 58, 545).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from hertzloop.fitting.fit.discrepancy import CORRELATIONS, Discrepancy

# The usual share, the standard deviations of its logarithm and of a record's own share.
_SHARE, _SHARE_SD, _APART_SD = 0.03, 1.5, 0.5
_ASKED = 6.0  # rise of twice the logarithm of the likelihood that a discrepancy has to bring
_STEPS = (1.5, 0.75, 0.375, 0.19)  # of logarithms, of the search
_KEPT, _GAIN, _NULL = 512, 1e-2, 1e-12


@dataclass
class RecordLikelihood:
    """What the likelihood needs of a record.

    Attributes:
        white: whitened derivatives and, as the last column, the residual, (samples, parameters +
            1).
        count: how many independent samples they are.
        discrepancy: on these samples; None if the model is exact.
        needed: whether a discrepancy was found before.
        least: noise over the present one that it has at least; None of a noise that is known.
        square: products of the columns of `white`.
    """

    white: np.ndarray
    count: float
    discrepancy: Discrepancy | None
    needed: bool
    least: float | None
    square: np.ndarray = field(init=False)
    _at_nodes: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.square = self.white.T @ self.white
        if self.discrepancy is not None:
            self._at_nodes = self.discrepancy.basis.T @ self.white

    def evaluate(
        self, shares: tuple[float, float], kappa: float, factor: float
    ) -> tuple[float, np.ndarray]:
        """Return the logarithm of the covariance's determinant, and the columns' products over it.

        Args:
            shares: of the discrepancy.
            kappa: of the discrepancy.
            factor: on the noise.
        """
        logarithm, square = 2.0 * self.count * math.log(factor), self.square / factor**2
        if self.discrepancy is None or not any(shares):
            return logarithm, square
        discrepancy = replace(self.discrepancy, shares=shares, kappa=kappa)
        discrepancy.__dict__["_gram"] = self.discrepancy._gram
        system = discrepancy.system(factor)
        columns = discrepancy.amplitude[:, np.newaxis] * self._at_nodes / factor**2
        square = square - columns.T @ scipy.linalg.cho_solve_banded((system, False), columns)
        return logarithm + discrepancy.logarithm(system), square


def estimate_discrepancies(
    records: Sequence[RecordLikelihood], priors: np.ndarray
) -> tuple[float, list[tuple[tuple[float, float], float]], float]:
    """Find the shares of the discrepancies, their correlation and unknown noises.

    Args:
        records: of a fit, at its solution.
        priors: derivatives and, as the last column, residuals of the priors, (rows, parameters +
            1).

    Returns:
        Minus twice the logarithm of the restricted likelihood, shares and factor on the noise of
        every record, and kappa. The shares are zero where the noise explains the residuals.
    """
    likelihood = _RestrictedLikelihood(records, priors)
    start = np.zeros(2 + 2 * len(records))
    start[:2] = math.log(_SHARE)
    best = likelihood.search(start, 0.0)
    if any(r.discrepancy is not None for r in records):
        searches = (likelihood.search(best[1], kappa) for kappa in CORRELATIONS)
        found = min(searches, key=lambda one: one[0])
        if any(r.needed for r in records) or found[0] < best[0] - _ASKED:
            best = found
    return best[0], likelihood.parts(best[1], best[2]), best[2]


class _RestrictedLikelihood:
    """The likelihood of discrepancies and noises, from which keys and nuisances are integrated out.

    A point of the search holds logarithms: the shares in the pulse and after it, the factor of each
    record on these, and the factor on each record's noise, (2 + 2 records,).
    """

    def __init__(self, records: Sequence[RecordLikelihood], priors: np.ndarray) -> None:
        self.records, self.priors = records, priors
        length = np.sqrt(sum((np.diag(r.square) for r in records), np.sum(priors**2, axis=0)))
        length[length == 0.0] = 1.0
        length[-1] = 1.0
        self._length = length
        self._cache: dict[tuple[float, ...], tuple[float, np.ndarray]] = {}

    def parts(self, at: np.ndarray, kappa: float) -> list[tuple[tuple[float, float], float]]:
        """Return shares and factor on the noise of every record at a point of the search; without
        a discrepancy if `kappa` is zero."""
        found, n = [], len(self.records)
        for i, r in enumerate(self.records):
            one, other = (math.exp(share + at[2 + i]) if kappa else 0.0 for share in at[:2])
            factor = 1.0 if r.least is None else max(math.exp(at[2 + n + i]), r.least)
            found.append(((one, other), factor))
        return found

    def cost(self, at: np.ndarray, kappa: float) -> float:
        """Return minus twice the logarithm of the likelihood, with the priors of the shares."""
        logarithm, square, n = 0.0, self.priors.T @ self.priors, len(self.records)
        for i, (shares, factor) in enumerate(self.parts(at, kappa)):
            key = (i, *shares, kappa, factor)
            if key not in self._cache:
                if len(self._cache) > _KEPT:
                    self._cache.clear()
                self._cache[key] = self.records[i].evaluate(shares, kappa, factor)
            logarithm += self._cache[key][0]
            square = square + self._cache[key][1]
        square = square / np.outer(self._length, self._length)
        values, vectors = np.linalg.eigh(square[:-1, :-1])
        known = values > _NULL * max(float(values[-1]), 1e-300)
        along = (vectors.T @ square[:-1, -1])[known]
        left = float(square[-1, -1] - np.sum(along**2 / values[known]))
        found = left + float(np.sum(np.log(values[known]))) + logarithm
        if kappa:
            found += float(np.sum((at[:2] - math.log(_SHARE)) ** 2)) / _SHARE_SD**2
            found += float(np.sum(at[2 : 2 + n] ** 2)) / _APART_SD**2
        return found

    def search(self, at: np.ndarray, kappa: float) -> tuple[float, np.ndarray, float]:
        """Return the lowest cost from a point, one coordinate after the other, where it is, and
        kappa."""
        n = len(self.records)
        moves = [2 + n + i for i, r in enumerate(self.records) if r.least is not None]
        if kappa:
            moves += [0, 1, *(range(2, 2 + n) if n > 1 else ())]
        now = self.cost(at, kappa)
        for step in _STEPS:
            improved = True
            while improved:
                improved = False
                for i, sign in ((i, sign) for i in moves for sign in (step, -step)):
                    new = at.copy()
                    new[i] += sign
                    while (c := self.cost(new, kappa)) < now - _GAIN:
                        at, now, improved = new, c, True
                        new = at.copy()
                        new[i] += sign
        return now, at, kappa
