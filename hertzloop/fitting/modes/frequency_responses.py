"""Measured frequency responses of several points, as rows that modes are fitted to."""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from hertzloop.fitting.modes.response_rows import FLEXIBILITY_M_N, ResponseRows
from hertzloop.fitting.modes.universal_file import RESPONSES
from hertzloop.fitting.modes.vector_fitting import start_poles

_LINES = 4000  # lines of a fit, evenly over the band; those around peaks are added
HELD_OUT_EVERY = 5  # every fifth line is held out
_AROUND_PEAK = 60  # lines on each side of a peak
_PEAK_LEVELS, _PEAK_HEIGHT = 20.0, 0.05  # least peak, over its noise; 1 dB, as a logarithm
_NOISE_GROUPS = 16  # groups of lines by the size of the value
_LEAST_NOISE = 1e-12  # square of the least noise of a value, over that of the value
_ABOVE_BAND = 1.1  # highest frequency of a mode, over that of the lines
_LINES_OF_BAND = 600  # frequencies within the band that count as apart
_MORE_MODES = 4  # modes at the start beyond the peaks


@dataclass(frozen=True)
class FrequencyResponses:
    """Frequency responses of several points to a force at one.

    Args:
        hz: frequencies of the lines, (lines,).
        values: motion over force, SI units, (points, lines).
        weights: of the values, (points, lines).
        order: 0 of receptances, 1 of mobilities, 2 of accelerances.
        nodes: of the points.
        reference: node of the force.
        direction: of force and motion, "x", "y" or "z".
    """

    hz: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    order: int
    nodes: tuple[int, ...]
    reference: int
    direction: str

    @property
    def kind(self) -> str:
        """Name of the response, such as "accelerance"."""
        return next(name for name, order in RESPONSES.items() if order == self.order)

    def at(self, lines: np.ndarray) -> "FrequencyResponses":
        """Return the responses at some lines, by their numbers or a mask, (lines,)."""
        return replace(
            self, hz=self.hz[lines], values=self.values[:, lines], weights=self.weights[:, lines]
        )

    @property
    def drive(self) -> int | None:
        """Which of the points is that of the force; None if none is."""
        return self.nodes.index(self.reference) if self.reference in self.nodes else None

    def observed(self) -> ResponseRows:
        """Return the responses as rows that modes are fitted to."""
        s = 2j * np.pi * self.hz
        by = s**self.order

        def basis(omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
            return by / (omega[:, None] ** 2 + s * (s + (loss * omega)[:, None]))

        x2 = (self.hz / self.hz[-1]) ** 2
        low, high = float(self.hz[0]), float(self.hz[-1])
        return ResponseRows(
            basis=basis,
            rest=FLEXIBILITY_M_N * np.array([by, by * x2, by * x2**2]),
            values=self.values,
            weights=self.weights,
            band_hz=(low, _ABOVE_BAND * high),
            resolution_hz=(high - low) / _LINES_OF_BAND,
            drive=self.drive,
        )

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies (rad/s) and loss factors of modes to begin with, (modes,) each."""
        s = 2j * np.pi * self.hz
        count = _MORE_MODES + max(map(len, map(_peaks, self.values, self.weights)))
        by = s**self.order
        return start_poles(s, self.values / by, np.abs(by) * self.weights, count)

    def thinned(self, most: int = _LINES) -> "FrequencyResponses":
        """Return the responses at so many lines over the band, and at all lines around peaks."""
        step = -(-len(self.hz) // most)
        kept = np.zeros(len(self.hz), bool)
        kept[::step] = True
        for pair in zip(self.values, self.weights, strict=True) if step > 1 else ():
            for peak in _peaks(*pair):
                kept[max(0, peak - _AROUND_PEAK) : peak + _AROUND_PEAK + 1] = True
        return self.at(kept)


def noise_weights(values: np.ndarray) -> np.ndarray:
    """Return the weights of a response, (lines,): one over the noise of its values, (lines,).

    The noise is a floor and a share of the value. It follows from the distances of the values from
    the straight line between their neighbours.
    """
    size = np.abs(values[1:-1]) ** 2
    apart = np.abs(values[:-2] - 2.0 * values[1:-1] + values[2:]) ** 2 / (6.0 * math.log(2.0))
    bins = np.array_split(np.argsort(size), _NOISE_GROUPS)
    noise = np.array([max(np.median(apart[some]), 1e-30 * np.mean(size)) for some in bins])
    of_size = np.array([np.median(size[some]) for some in bins])
    share, floor = scipy.optimize.nnls(
        np.stack([of_size, np.ones(_NOISE_GROUPS)], 1) / noise[:, None], np.ones(_NOISE_GROUPS)
    )[0]
    return 1.0 / np.sqrt(max(share, _LEAST_NOISE) * np.abs(values) ** 2 + floor)


def _peaks(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the lines at which a response has a peak that is well above its noise, (peaks,)."""
    found = scipy.signal.find_peaks(np.log10(np.abs(values)), prominence=_PEAK_HEIGHT)[0]
    return np.asarray(found[np.abs(values[found]) * weights[found] > _PEAK_LEVELS])
