"""Measured responses as rows of a least-squares problem, and the modes that solve it.

A response is s^n (sum R_k/(s^2 + eta_k w_k s + w_k^2) + rest) times the force, with real residues
R_k: those of normal modes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

FLEXIBILITY_M_N = 1e-9  # unit of the rest of a response
LEAST_LOSS, MOST_LOSS = 1e-7, 1.0  # loss factors that a mode may have


@dataclass(frozen=True)
class ResponseRows:
    """Measured responses of several points to known forces at one.

    Args:
        basis: responses of modes of unit residue, (modes, rows), by their frequencies, rad/s, and
            loss factors, (modes,) each.
        rest: responses of the terms that stand for the modes beyond the band, (terms, rows).
        values: measured rows, (points, rows), real or complex.
        weights: their weights, (points, rows).
        band_hz: lowest and highest frequency of a mode.
        resolution_hz: least distance of two frequencies that the rows distinguish.
        drive: which point is that of the force, where no passive structure has a negative residue;
            None if none is.
        least_width_hz: least bandwidth of a mode.
    """

    basis: Callable[[np.ndarray, np.ndarray], np.ndarray]
    rest: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    band_hz: tuple[float, float]
    resolution_hz: float
    drive: int | None = None
    least_width_hz: float = 0.0

    def columns(self, omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Return the responses of all modes and of the rest, (modes + terms, rows)."""
        return np.concatenate([self.basis(omega, loss), self.rest])

    @property
    def count(self) -> int:
        """How many real numbers were measured."""
        return self.values.size * (2 if np.iscomplexobj(self.values) else 1)


@dataclass(frozen=True)
class FittedModes:
    """Modes that were fitted to responses.

    Args:
        omega_rad_s: natural frequencies, (modes,).
        loss_factor: loss factors, (modes,).
        residues: of the receptances, 1/kg, (points, modes).
        rest: factors of the terms beyond the band, (points, terms).
        square: weighted sum of the squares that they leave.
    """

    omega_rad_s: np.ndarray
    loss_factor: np.ndarray
    residues: np.ndarray
    rest: np.ndarray
    square: float

    def response(self, observed: ResponseRows) -> np.ndarray:
        """Return the responses of the modes to the forces of some rows, (points, rows)."""
        columns = observed.columns(self.omega_rad_s, self.loss_factor)
        return np.concatenate([self.residues, self.rest], axis=1) @ columns


def real_rows(rows: np.ndarray) -> np.ndarray:
    """Return real and imaginary parts behind each other, (..., rows) to (..., twice the rows); real
    rows stay as they are."""
    return np.concatenate([rows.real, rows.imag], axis=-1) if np.iscomplexobj(rows) else rows
