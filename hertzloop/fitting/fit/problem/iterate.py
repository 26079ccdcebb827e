"""An iterate of a fit: parameters, predictions, residuals, and derivatives."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Prediction(NamedTuple):
    """What a channel should read, (samples,) each.

    Attributes:
        value: without gain and offset, in the unit of the record.
        slope: derivative of the value by time, 1/s.
        tau: times after the touch, s.
        reading: with gain and offset.
    """

    value: np.ndarray
    slope: np.ndarray
    tau: np.ndarray
    reading: np.ndarray


class ChannelIterate(NamedTuple):
    """A channel at an iterate.

    Attributes:
        predicted: what it should read.
        counted: which of its samples count, (samples,).
        rows: where these stand in the residual.
    """

    predicted: Prediction
    counted: np.ndarray
    rows: slice


@dataclass
class Iterate:
    """Parameters of a fit with their residuals.

    Attributes:
        x: logarithms of the keys, then nuisances, (parameters,).
        until_s: end of the window after the touch, s.
        residual: whitened rows of all channels, rows of the discrepancies, and rows of the priors,
            (rows,).
        jacobian: derivatives of the residual, (rows, parameters).
        channels: of the fit.
        prior_rows: rows of the priors.
    """

    x: np.ndarray
    until_s: float
    residual: np.ndarray
    jacobian: np.ndarray
    channels: list[ChannelIterate]
    prior_rows: slice

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals, priors included."""
        return float(self.residual @ self.residual)

    @property
    def empty_channels(self) -> int:
        """How many channels have no sample in the window."""
        return sum(not np.any(c.counted) for c in self.channels)

    def pseudo_inverse(self, least: float = 1e-15) -> np.ndarray:
        """Pseudo-inverse of the Jacobian with columns of length one, scaled back; shape
        (parameters, rows). `least`: singular value that counts, over the largest."""
        length = np.sqrt(np.sum(self.jacobian**2, axis=0))
        length[length == 0.0] = 1.0
        return np.linalg.pinv(self.jacobian / length, rcond=least) / length[:, np.newaxis]

    def covariance(self) -> np.ndarray:
        """Return the covariance of all parameters, (parameters, parameters)."""
        inverse = self.pseudo_inverse()
        return np.asarray(inverse @ inverse.T)
