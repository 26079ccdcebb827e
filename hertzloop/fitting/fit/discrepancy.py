"""The discrepancy of a model: a smooth random signal of unknown size beside the noise of a record.

It is the local size of the simulated signal, times a share, times a stationary Gaussian
process of unit variance (Matern). The process has nodes a part of a contact time apart, and a
banded precision matrix (Lindgren, Rue and Lindstroem 2011, J. R. Stat. Soc. B 73, 423).
"""

import math
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
