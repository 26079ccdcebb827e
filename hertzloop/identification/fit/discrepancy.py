"""What the model leaves of a record beyond its noise: a smooth random error of unknown size.

The error is the local size of the simulated signal, times a share, times a stationary Gaussian
process of unit variance (Matern). The process has nodes a part of a contact time apart, and a
banded precision matrix (Lindgren, Rue and Lindstroem 2011, J. R. Stat. Soc. B 73, 423). Shares,
correlation and unknown noise maximise the restricted likelihood, from which keys and nuisances are
integrated out (Patterson and Thompson 1971, Biometrika 58, 545).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy

PULSE = 1.5  # contact times, the end of the pulse
_NODES, _MOST_NODES = 16, 6000  # in a contact time; in a record
_BEFORE = 0.6  # contact times from the first node to the touch
# Contact times: of the local size of a signal, and in which what it was before is forgotten.
_WIDTH, _MEMORY = 0.25, 5.0
_ORDER, _VARIANCE = 4, 5.0 / 32.0  # of the process; its variance times kappa^7
_KAPPAS = (2.0, 4.0, 8.0, 16.0, 32.0)  # over the contact time; the last of coarse samples only
# The usual share, the standard deviations of its logarithm and of a record's own share.
_SHARE, _SHARE_SD, _APART_SD = 0.03, 1.5, 0.5
_ASKED = 6.0  # rise of twice the logarithm of the likelihood that an error has to bring
_STEPS = (1.5, 0.75, 0.375, 0.19)  # of logarithms, of the search
_KEPT, _GAIN, _NULL = 512, 1e-2, 1e-12


@dataclass(frozen=True)
class Discrepancy:
    """The error of the model in one record.

    `shares`: of the local signal, in the pulse and after it. `kappa`: over the contact time; the
    correlation falls to a tenth in 5.3 contact times over kappa. `basis`: sparse, (samples, nodes),
    whitened. `sizes`: of the signal at the nodes in the pulse and after it, (2, nodes). `spacing`:
    of the nodes, contact times.
    """

    shares: tuple[float, float]
    kappa: float
    basis: Any
    sizes: np.ndarray
    spacing: float
    _on: dict[bytes, "Discrepancy"] = field(default_factory=dict, compare=False)

    def on(self, counted: np.ndarray) -> "Discrepancy":
        """The error on the samples that count, (samples,)."""
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
        """Logarithm of the determinant of error and noise over that of the noise."""
        return 2.0 * float(np.sum(np.log(system[-1])) - np.sum(np.log(self._prior[1][-1])))

    def applied(self, white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split whitened rows into what the noise and what the error has to explain.

        Args:
            white: rows of a residual or of derivatives, (samples,) or (samples, columns).

        Returns:
            Rows for the noise, as `white`, and for the error, (nodes,) or (nodes, columns). The
            products of their columns are those of `white` over noise and error together.
        """
        flat, a = white.reshape(len(white), -1), self.amplitude[:, np.newaxis]
        found = scipy.linalg.cho_solve_banded((self._solved, False), a * (self.basis.T @ flat))
        upper, rows = self._prior[1], np.zeros_like(found)
        for k in range(len(upper)):
            rows[: len(rows) - k] += upper[-1 - k, k:, np.newaxis] * found[k:]
        rest = flat - self.basis @ (a * found)
        return rest.reshape(white.shape), rows.reshape((-1, *white.shape[1:]))


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


def build_discrepancy(
    tau_s: np.ndarray,
    signal: np.ndarray,
    whitening: Any,
    contact_s: float,
    wall_hz: float | None = None,
) -> Discrepancy | None:
    """Return an error of unknown size; None for a record that ends in the contact.

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
    return Discrepancy((0.0, 0.0), _KAPPAS[0], (whitening @ basis).tocsr(), sizes, spacing)


@dataclass
class RecordLikelihood:
    """What the likelihood needs of a record.

    `white`: whitened derivatives and, as the last column, the residual, (samples, parameters + 1).
    `count`: how many independent samples they are. `error`: on these samples; None if the model is
    exact. `needed`: whether an error was asked for before. `least`: noise over the present one that
    it has at least; None of a noise that is known.
    """

    white: np.ndarray
    count: float
    error: Discrepancy | None
    needed: bool
    least: float | None
    _square: np.ndarray = field(init=False)
    _at_nodes: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._square = self.white.T @ self.white
        if self.error is not None:
            self._at_nodes = self.error.basis.T @ self.white

    def stated(
        self, shares: tuple[float, float], kappa: float, factor: float
    ) -> tuple[float, np.ndarray]:
        """Logarithm of the determinant of the covariance, and products of the columns over it.

        Args:
            shares: of the error.
            kappa: of the error.
            factor: on the noise.
        """
        logarithm, square = 2.0 * self.count * math.log(factor), self._square / factor**2
        if self.error is None or not any(shares):
            return logarithm, square
        error = replace(self.error, shares=shares, kappa=kappa)
        error.__dict__["_gram"] = self.error._gram
        system = error.system(factor)
        columns = error.amplitude[:, np.newaxis] * self._at_nodes / factor**2
        square = square - columns.T @ scipy.linalg.cho_solve_banded((system, False), columns)
        return logarithm + error.logarithm(system), square


def estimate_discrepancies(
    records: Sequence[RecordLikelihood], priors: np.ndarray
) -> tuple[float, list[tuple[tuple[float, float], float]], float]:
    """Find the shares of the errors, their correlation and unknown noises.

    Args:
        records: of a fit, at its solution.
        priors: derivatives and, as the last column, residuals of the priors, (rows, parameters +
            1).

    Returns:
        Minus twice the logarithm of the restricted likelihood, shares and factor on the noise of
        every record, and kappa. The shares are zero where the noise explains the residuals.
    """
    n = len(records)
    length = np.sqrt(sum((np.diag(r._square) for r in records), np.sum(priors**2, axis=0)))
    length[length == 0.0] = 1.0
    length[-1] = 1.0
    kept: dict[tuple[float, ...], tuple[float, np.ndarray]] = {}

    def parts(at: np.ndarray, kappa: float) -> list[tuple[tuple[float, float], float]]:
        """Shares and factor of every record at a point of the search."""
        found = []
        for i, r in enumerate(records):
            one, other = (math.exp(share + at[2 + i]) if kappa else 0.0 for share in at[:2])
            factor = 1.0 if r.least is None else max(math.exp(at[2 + n + i]), r.least)
            found.append(((one, other), factor))
        return found

    def cost(at: np.ndarray, kappa: float) -> float:
        logarithm, square = 0.0, priors.T @ priors
        for i, (shares, factor) in enumerate(parts(at, kappa)):
            key = (i, *shares, kappa, factor)
            if key not in kept:
                if len(kept) > _KEPT:
                    kept.clear()
                kept[key] = records[i].stated(shares, kappa, factor)
            logarithm += kept[key][0]
            square = square + kept[key][1]
        square = square / np.outer(length, length)
        values, vectors = np.linalg.eigh(square[:-1, :-1])
        known = values > _NULL * max(float(values[-1]), 1e-300)
        along = (vectors.T @ square[:-1, -1])[known]
        left = float(square[-1, -1] - np.sum(along**2 / values[known]))
        found = left + float(np.sum(np.log(values[known]))) + logarithm
        if kappa:
            found += float(np.sum((at[:2] - math.log(_SHARE)) ** 2)) / _SHARE_SD**2
            found += float(np.sum(at[2 : 2 + n] ** 2)) / _APART_SD**2
        return found

    def searched(at: np.ndarray, kappa: float) -> tuple[float, np.ndarray, float]:
        """The lowest cost from a point, one coordinate after the other."""
        moves = [2 + n + i for i, r in enumerate(records) if r.least is not None]
        if kappa:
            moves += [0, 1, *(range(2, 2 + n) if n > 1 else ())]
        now = cost(at, kappa)
        for step in _STEPS:
            improved = True
            while improved:
                improved = False
                for i, sign in ((i, sign) for i in moves for sign in (step, -step)):
                    new = at.copy()
                    new[i] += sign
                    while (c := cost(new, kappa)) < now - _GAIN:
                        at, now, improved = new, c, True
                        new = at.copy()
                        new[i] += sign
        return now, at, kappa

    start = np.zeros(2 + 2 * n)
    start[:2] = math.log(_SHARE)
    best = searched(start, 0.0)
    if any(r.error is not None for r in records):
        coarse = any(r.error is not None and r.error.basis.shape[1] > len(r.white) for r in records)
        kappas = _KAPPAS if coarse else _KAPPAS[:-1]
        found = min((searched(best[1], kappa) for kappa in kappas), key=lambda one: one[0])
        if any(r.needed for r in records) or found[0] < best[0] - _ASKED:
            best = found
    return best[0], parts(best[1], best[2]), best[2]
