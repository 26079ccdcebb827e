"""The discrepancy of a model: a smooth random signal of unknown size beside the noise of a record.

It is the local size of the simulated signal, times a share, times a stationary Gaussian
process of unit variance (Matern). The process has nodes a part of a contact time apart, and a
banded precision matrix (Lindgren, Rue and Lindstroem 2011, J. R. Stat. Soc. B 73, 423).

Shares, correlation and unknown noises maximise the restricted likelihood, from which keys and
nuisances are integrated out (Patterson and Thompson 1971, Biometrika 58, 545).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy

PULSE = 1.5  # end of the pulse, contact times
CORRELATIONS = (2.0, 4.0, 8.0, 16.0, 32.0)  # over the contact time
_NODES, _MOST_NODES = 16, 6000  # nodes in a contact time; most nodes in a record
_BEFORE = 0.6  # from the first node to the touch, contact times
_WIDTH = 0.25  # width of the average that gives the local size of a signal, contact times
_MEMORY = 5.0  # decay of the size after a signal, contact times
_ORDER = 4  # of the process
_VARIANCE = 5.0 / 32.0  # of the process, times kappa^7
# The usual share, the standard deviations of its logarithm and of a record's own share.
_SHARE, _SHARE_SD, _APART_SD = 0.03, 1.5, 0.5
_ASKED = 6.0  # rise of twice the logarithm of the likelihood that a discrepancy has to bring
_STEPS = (1.5, 0.75, 0.375, 0.19)  # of logarithms, of the search
_KEPT, _GAIN, _NULL = 512, 1e-2, 1e-12


@dataclass(frozen=True)
class Discrepancy:
    """The discrepancy of the model in one record.

    Attributes:
        shares: of the local signal, in the pulse and after it.
        kappa: over the contact time; the correlation falls to a tenth in 5.3 contact times over
            kappa.
        basis: whitened values of the process by those at the nodes, sparse, (samples, nodes).
        sizes: of the signal at the nodes, in the pulse and after it, (2, nodes).
        spacing: of the nodes, contact times.
    """

    shares: tuple[float, float]
    kappa: float
    basis: Any
    sizes: np.ndarray
    spacing: float
    _on: dict[bytes, "Discrepancy"] = field(default_factory=dict, compare=False)

    def on_samples(self, counted: np.ndarray) -> "Discrepancy":
        """Return the discrepancy on the samples that count. `counted`: (samples,), bool."""
        key = counted.tobytes()
        if key not in self._on:
            self._on.clear()
            self._on[key] = replace(self, basis=self.basis[counted], _on={})
        return self._on[key]

    @cached_property
    def amplitude(self) -> np.ndarray:
        """Standard deviation at the nodes, in the unit of the record, (nodes,)."""
        return np.asarray(self.shares @ self.sizes)

    @property
    def overall(self) -> float:
        """Share of the whole signal, root mean square."""
        return math.sqrt(float(np.sum(self.amplitude**2) / np.sum(self.sizes**2)))

    @cached_property
    def _gram(self) -> np.ndarray:
        return _banded(self.basis.T @ self.basis)

    @property
    def _prior(self) -> tuple[np.ndarray, np.ndarray]:
        return _precision(self.sizes.shape[1], self.spacing, self.kappa)

    def system(self, factor: float = 1.0) -> np.ndarray:
        """Cholesky factor, upper banded, of the precision of the process given a record whose noise
        is `factor` times larger."""
        a, gram, precision = self.amplitude, self._gram, self._prior[0]
        found = np.zeros((max(len(gram), len(precision)), len(a)))
        found[len(found) - len(precision) :] = precision
        for k in range(len(gram)):
            found[-1 - k, k:] += gram[-1 - k, k:] * a[k:] * a[: len(a) - k] / factor**2
        return np.asarray(scipy.linalg.cholesky_banded(found))

    @cached_property
    def _solved(self) -> np.ndarray:
        return self.system()

    def logarithm(self, system: np.ndarray) -> float:
        """Logarithm of the determinant of discrepancy and noise over that of the noise."""
        return 2.0 * float(np.sum(np.log(system[-1])) - np.sum(np.log(self._prior[1][-1])))

    def split_rows(self, white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split whitened rows into what the noise and what the discrepancy has to explain.

        Args:
            white: rows of a residual or of derivatives, (samples,) or (samples, columns).

        Returns:
            Rows for the noise, as `white`, and for the discrepancy, (nodes,) or (nodes, columns).
            The products of their columns are those of `white` over noise and discrepancy together.
        """
        flat = white if white.ndim == 2 else white[:, np.newaxis]
        a = self.amplitude[:, np.newaxis]
        found = scipy.linalg.cho_solve_banded((self._solved, False), a * (self.basis.T @ flat))
        upper, rows = self._prior[1], np.zeros_like(found)
        for k in range(len(upper)):
            rows[: len(rows) - k] += upper[-1 - k, k:, np.newaxis] * found[k:]
        rest = flat - self.basis @ (a * found)
        return rest.reshape(white.shape), rows.reshape((-1, *white.shape[1:]))


def build_discrepancy(
    tau_s: np.ndarray,
    signal: np.ndarray,
    whitening: Any,
    contact_s: float,
    wall_hz: float | None = None,
) -> Discrepancy | None:
    """Return a discrepancy of unknown size; None for a record that ends in the contact.

    Args:
        tau_s: times after the touch, s, rising, (samples,).
        signal: what the model reads there, without offset, in the unit of the record, (samples,).
        whitening: matrix that makes white noise of the record's, (samples, samples).
        contact_s: contact time, s.
        wall_hz: corner of a brick wall, which rings on both sides of a pulse.
    """
    t = tau_s / contact_s
    first, last = -_BEFORE, float(t[-1])
    if wall_hz is not None:
        first = min(first, float(t[0]))
    if last < 0.5:
        return None
    spacing = max(1.0 / _NODES, (last - first) / _MOST_NODES)
    nodes = math.ceil((last - first) / spacing) + 2
    grid = first + spacing * np.arange(nodes)
    inside = np.flatnonzero(t >= first)
    left = ((t[inside] - first) / spacing).astype(int)
    share = (t[inside] - first) / spacing - left
    places = np.concatenate([inside, inside]), np.concatenate([left, left + 1])
    basis = scipy.sparse.csr_array(
        (np.concatenate([1.0 - share, share]), places), shape=(len(t), nodes)
    )
    square = np.interp(grid, t, signal) ** 2
    if wall_hz is None:
        square = scipy.ndimage.gaussian_filter1d(square, _WIDTH / spacing)
    else:
        rings = 1.0 / (1.0 + (np.pi * wall_hz * contact_s * (grid - grid[nodes // 2])) ** 2)
        square = np.convolve(square, rings / np.sum(rings), mode="same")
    decay = math.exp(-spacing / _MEMORY)
    before = scipy.signal.lfilter([1.0 - decay], [1.0, -decay], square)
    size = np.sqrt(2.0 * np.maximum(square, before))
    sizes = np.stack([np.where(grid < PULSE, size, 0.0), np.where(grid < PULSE, 0.0, size)])
    return Discrepancy((0.0, 0.0), CORRELATIONS[0], (whitening @ basis).tocsr(), sizes, spacing)


def _banded(square: Any) -> np.ndarray:
    """Upper banded form of a symmetric sparse matrix."""
    coo = square.tocoo()
    upper = coo.col >= coo.row
    row, col = coo.row[upper], coo.col[upper]
    width = int(np.max(col - row, initial=0))
    found = np.zeros((width + 1, square.shape[0]))
    found[width - (col - row), col] = coo.data[upper]
    return found


@lru_cache(32)
def _precision(nodes: int, spacing: float, kappa: float) -> tuple[np.ndarray, np.ndarray]:
    """Precision of the process of unit variance at its nodes, and its Cholesky factor, both upper
    banded."""
    mass = np.full(nodes, spacing)
    stiff = np.full(nodes, 2.0 / spacing)
    mass[[0, -1]] *= 0.5
    stiff[[0, -1]] *= 0.5
    off = np.full(nodes - 1, -1.0 / spacing)
    # pyrefly: ignore[no-matching-overload]
    one: Any = scipy.sparse.diags_array([off, kappa**2 * mass + stiff, off], offsets=[-1, 0, 1])
    inverse: Any = scipy.sparse.diags_array(1.0 / mass)
    found = one = one.tocsr()
    for _ in range(_ORDER - 1):
        found = found @ inverse @ one
    whole = _banded(found * (_VARIANCE / kappa**7))
    return whole, scipy.linalg.cholesky_banded(whole)


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
