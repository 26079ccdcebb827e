"""Modes of a rectangular plate far above its first ones, by the dynamic edge effect (Bolotin 1961).

Away from the edges a mode is sin(k_x x + a_x) sin(k_y y + a_y), w = sqrt(B'/m'') (k_x^2 +
k_y^2). At an edge a term exp(-kappa x), kappa^2 = k_x^2 + 2 k_y^2, joins it, and both fulfil the
edge's two conditions for one phase a, between -pi/2 and 0; a mode has k_x l_x + a_0 + a_1 = m
pi, m = 1, 2, ..., and the same along y. A free edge has one mode more for every n, which is
nearly straight across the plate or, at higher frequencies, runs along the edge and dies away
from it: those follow from the strip between the two edges. What happens in the corners is left
out.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.beam_basis import BeamBasis, families

_ROUNDS = 40
_STRIP_ROUNDS = 4  # of strip and phase in turn
_STRIP_FUNCTIONS = 36


class WaveSide(NamedTuple):
    """Shapes of modes along one coordinate: wave numbers (1/m) and their squares across, or
    (`strip`) coefficients of a `BeamBasis`, (functions, modes)."""

    k: np.ndarray
    t_squared: np.ndarray
    strip: np.ndarray | None = None

    def of(self, kept: np.ndarray) -> "WaveSide":
        """The same for some of the modes."""
        strip = None if self.strip is None else self.strip[:, kept]
        return WaveSide(self.k[kept], self.t_squared[kept], strip)


class Waves(NamedTuple):
    """Some modes of the same kind; `squared`: w sqrt(m''/D) (1/m^2), (modes,)."""

    squared: np.ndarray
    along_x: WaveSide
    along_y: WaveSide

    def within(self, least: float, most: float) -> "Waves":
        """The modes with k^2 from `least` to `most`."""
        kept = (self.squared >= least) & (self.squared <= most)
        return Waves(self.squared[kept], self.along_x.of(kept), self.along_y.of(kept))


def _phase(edge: str, k: np.ndarray, t2: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Phase and weight of the exponential at an edge, k across it, t2 = t^2 along it."""
    if edge == "s":
        return np.zeros_like(k), np.zeros_like(k)
    kappa = np.sqrt(k * k + 2.0 * t2)
    if edge == "c":
        phase = -np.arctan2(k, kappa)
        return phase, -np.sin(phase)
    a, b = k * k + nu * t2, k * k + (2.0 - nu) * t2
    phase = -np.arctan2(k * b * b, kappa * a * a)
    return phase, a * np.sin(phase) / b


def _numbers(
    count: np.ndarray, edges: str, length: float, k: np.ndarray, t2: np.ndarray, nu: float
) -> np.ndarray:
    """The next estimate of the wave number of mode `count` between two edges."""
    turned = _phase(edges[0], k, t2, nu)[0] + _phase(edges[1], k, t2, nu)[0]
    return np.asarray((count * np.pi - turned) / length)


def waves(edges: str, size_m: tuple[float, float], nu: float, k_max: float) -> list[Waves]:
    """All modes with w sqrt(m''/D) <= k_max^2; the corners' share left out."""
    every = labelled_waves(edges, size_m, nu, k_max)
    return [group.within(0.0, k_max * k_max) for group in every]


def labelled_waves(
    edges: str, size_m: tuple[float, float], nu: float, k_max: float, rounds: int = _ROUNDS
) -> list[Waves]:
    """The modes up to k_max and some beyond, in an order that no Poisson's ratio changes."""
    (lx, ly), (ex, ey) = size_m, (edges[:2], edges[2:])
    highest = [np.arange(1.0, int(k_max * length / np.pi) + 2) for length in size_m]
    m, n = (grid.ravel() for grid in np.meshgrid(*highest, indexing="ij"))
    kx, ky = m * np.pi / lx, n * np.pi / ly
    for _ in range(rounds):
        kx, ky = _numbers(m, ex, lx, kx, ky * ky, nu), _numbers(n, ey, ly, ky, kx * kx, nu)
    found = [Waves(kx * kx + ky * ky, WaveSide(kx, ky * ky), WaveSide(ky, kx * kx))]
    for squared, across, along in _edge_waves(ex, ey, lx, ly, nu, k_max, rounds):
        found.append(Waves(squared, across, along))
    for squared, across, along in _edge_waves(ey, ex, ly, lx, nu, k_max, rounds):
        found.append(Waves(squared, along, across))
    return found


@on_one_thread
def _edge_waves(
    across: str, along: str, width: float, length: float, nu: float, k_max: float, rounds: int
) -> list[tuple[np.ndarray, WaveSide, WaveSide]]:
    """For every free edge of `across` the modes that run along it: k^2, shape across, along."""
    basis = BeamBasis(across, width, _STRIP_FUNCTIONS)
    bend, mixed, slope = basis.integrals()
    mixed = mixed + mixed.T
    at_free = basis.at(np.array([0.0 if across[0] == "f" else width]))
    n = np.arange(1.0, int(k_max * length / np.pi) + 2)
    found = []
    # Two free edges have an even and an odd mode, with almost equal k^2: each of its own functions.
    for part in families(across, _STRIP_FUNCTIONS)[: across.count("f")]:
        inside = np.ix_(part, part)
        k, t2 = n * np.pi / length, np.zeros(len(n))
        for _ in range(_STRIP_ROUNDS):
            for _ in range(rounds):
                k = _numbers(n, along, length, k, t2, nu)
            k2 = (k * k)[:, None, None]
            strip = (bend + k2 * (2.0 * (1.0 - nu) * slope - nu * mixed))[(..., *inside)]
            values, vectors = np.linalg.eigh(strip + k2 * k2 * np.eye(len(part)))
            squared = np.sqrt(np.maximum(values[:, 0], 0.0))
            t2 = np.maximum(squared - k * k, -0.45 * k * k)
        shape = np.zeros((_STRIP_FUNCTIONS, len(n)))
        shape[part] = vectors[:, :, 0].T
        shape *= np.sign(at_free @ shape)  # one sign at every Poisson's ratio
        found.append((squared, WaveSide(k, k * k, shape), WaveSide(k, t2)))
    return found


@on_one_thread
def shape_along(
    edges: str, length_m: float, side: WaveSide, nu: float, x_m: np.ndarray
) -> np.ndarray:
    """Shapes along a coordinate, unit integral of the square; (points, modes)."""
    x = np.asarray(x_m, dtype=float)
    if side.strip is not None:
        return BeamBasis(edges, length_m, len(side.strip)).at(x) @ side.strip
    k, t2, x = side.k, side.t_squared, x[:, None]
    (a0, c0), (a1, c1) = (_phase(edge, k, t2, nu) for edge in edges)
    kappa = np.sqrt(k * k + 2.0 * t2)
    # sin^2, then what the exponentials add: twice their product with the sine, and their square.
    norm = 0.5 * length_m + (np.sin(2.0 * a0) + np.sin(2.0 * a1)) / (4.0 * k)
    for a, c in ((a0, c0), (a1, c1)):
        norm = norm + 2.0 * c * (k * np.cos(a) + kappa * np.sin(a)) / (k * k + kappa * kappa)
        norm = norm + c * c / (2.0 * kappa)
    # Seen from the far edge the sine has the sign of -cos(m pi).
    far = -np.cos(np.round((k * length_m + a0 + a1) / np.pi) * np.pi) * c1
    inside = np.sin(k * x + a0) + c0 * np.exp(-kappa * x) + far * np.exp(-kappa * (length_m - x))
    return np.asarray(inside / np.sqrt(norm))
