"""Transfer functions of laws: a sum of partial fractions, or a product of stages."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from hertzloop.controller.law import Response
from hertzloop.controller.laws import linear

INSIDE = 1e-9  # a pole this close to the unit circle counts as inside it


@dataclass(frozen=True)
class LawFilter:
    """Transfer function of a law.

    direct + sum of residues/(Z - pole) + sum of taps[k]/Z^(k + 1), with all poles listed.
    """

    direct: float
    poles: np.ndarray
    residues: np.ndarray
    taps: np.ndarray = field(default_factory=lambda: np.empty(0))

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return the response at complex `z`, same shape."""
        z = np.asarray(z, complex)
        return self.with_slope(z.ravel())[0].reshape(z.shape)

    def with_slope(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the response and its derivative by Z, at complex `z` of shape (n,)."""
        found, slope = np.full(len(z), complex(self.direct)), np.zeros(len(z), complex)
        for pole, residue in zip(self.poles, self.residues, strict=True):
            part = residue / (z - pole)
            found += part
            slope -= part / (z - pole)
        power = np.ones(len(z), complex)
        for k, tap in enumerate(self.taps, 1):
            power = power / z
            found += tap * power
            slope -= k * tap * power / z
        return found, slope


@dataclass(frozen=True)
class Cascade(LawFilter):
    """Transfer function of a law as a product of stages, which keeps its digits where partial
    fractions lose them.

    An integrator counts as a slow decay.

    Attributes:
        gain: factor on all stages.
        numerators: coefficients of 1, 1/Z, ... of each stage.
    """

    gain: float = 1.0
    numerators: tuple[np.ndarray, ...] = ()

    @classmethod
    def of(cls, declared: Response) -> Self:
        """Return the filter of the stages that a law declares."""
        poles = np.concatenate([linear.roots(a) for _, a in declared.stages])
        size = np.abs(poles)
        on_circle = np.abs(size - 1.0) < INSIDE
        poles = np.where(on_circle, poles * (1.0 - INSIDE) / np.maximum(size, 0.5), poles)
        return cls(
            np.nan,
            poles,
            np.full(len(poles), np.nan + 0j),
            gain=float(declared.gain),
            numerators=tuple(b for b, _ in declared.stages),
        )

    def with_slope(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the response and its derivative by Z, at complex `z` of shape (n,)."""
        found, relative = np.full(len(z), complex(self.gain)), np.zeros(len(z), complex)
        for b in self.numerators:
            some = np.flatnonzero(b)
            if not len(some):
                return np.zeros(len(z), complex), np.zeros(len(z), complex)
            found = found * b[some[0]] * z ** -float(some[0])
            relative = relative - some[0] / z
            for zero in linear.roots(b[some[0] :]):  # factors keep their digits near Z = 1
                found = found * (1.0 - zero / z)
                with np.errstate(all="ignore"):  # at a zero only the product has a limit
                    relative = relative + zero / (z * (z - zero))
        for pole in self.poles:
            found = found / (1.0 - pole / z)
            relative = relative - pole / (z * (z - pole))
        with np.errstate(invalid="ignore"):
            return found, found * relative
