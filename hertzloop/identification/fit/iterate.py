"""An iterate of a fit: parameters, residuals, and derivatives."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Iterate:
    """Parameters of a fit with their residuals.

    Attributes:
        x: logarithms of the keys, then nuisances, (parameters,).
        residual: whitened rows of all channels, rows of the model's errors, and rows of the
            priors, (rows,).
        jacobian: derivatives of the residual, (rows, parameters).
        channel_rows: rows of each channel.
        prior_rows: rows of the priors.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    channel_rows: list[slice]
    prior_rows: slice

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals, priors included."""
        return float(self.residual @ self.residual)

    @property
    def empty_channels(self) -> int:
        """How many channels have no sample in the window."""
        return sum(rows.start == rows.stop for rows in self.channel_rows)

    def pseudo_inverse(self, least: float = 1e-15) -> np.ndarray:
        """Pseudo-inverse of the Jacobian with columns of length one, scaled back; shape
        (parameters, rows). `least`: singular value that counts, over the largest."""
        length = np.sqrt(np.sum(self.jacobian**2, axis=0))
        length[length == 0.0] = 1.0
        return np.linalg.pinv(self.jacobian / length, rcond=least) / length[:, np.newaxis]
