"""The products of keys that records tell best and worst."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.fitting.fit.verdicts import half_width

_SHOWN = 0.05  # exponents of a combination below this are left away


@dataclass(frozen=True)
class KeyCombination:
    """A product of keys: exponents by key, and its 95 % half-width, %; inf if nothing is known."""

    exponents: dict[str, float]
    half_width_percent: float

    def __str__(self) -> str:
        parts = []
        for key, power in self.exponents.items():
            parts.append(key if abs(power - 1.0) < 5e-3 else f"{key}^{power:.2g}")
        return " * ".join(parts)


def key_combinations(keys: list[str], covariance: np.ndarray) -> list[KeyCombination]:
    """The principal directions of the logarithms: the worst known product of keys first."""
    if len(keys) < 2 or not np.all(np.isfinite(covariance)):
        return [
            KeyCombination({key: 1.0}, math.inf)
            for key, value in zip(keys, np.diag(covariance), strict=True)
            if not math.isfinite(value)
        ]
    values, vectors = np.linalg.eigh(covariance)
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        largest = vector[np.argmax(np.abs(vector))]
        powers = {
            key: float(power / largest)
            for key, power in zip(keys, vector, strict=True)
            if abs(power / largest) >= _SHOWN
        }
        # The product with these exponents changes by |exponents|^2 along the direction.
        length = math.sqrt(sum(p * p for p in powers.values()))
        sd = math.sqrt(max(float(value), 0.0)) * length
        found.append(KeyCombination(powers, 100.0 * half_width(sd)))
    return found
