"""Transfer function of a law as a product of stages."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from hertzloop.controller.law import Response
from hertzloop.controller.laws import linear
from hertzloop.studies.margin.linear import TransferFunction

INSIDE = 1e-9  # a pole this close to the unit circle counts as inside it


@dataclass(frozen=True)
class Cascade(TransferFunction):
    """Transfer function of a law as a product of stages, which keeps its digits where partial
    fractions lose them: it has no residues.

    An integrator counts as a slow decay.

    Attributes:
        gain: factor on all stages.
        numerators: coefficients of 1, 1/Z, ... of each stage.
    """

    gain: float
    numerators: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, declared: Response) -> Self:
        """Return the filter of the stages that a law declares."""
        poles = np.concatenate([linear.roots(a) for _, a in declared.stages])
        size = np.abs(poles)
        on_circle = np.abs(size - 1.0) < INSIDE
        poles = np.where(on_circle, poles * (1.0 - INSIDE) / np.maximum(size, 0.5), poles)
        unknown = np.full(len(poles), np.nan)
        numerators = tuple(b for b, _ in declared.stages)
        return cls(poles, unknown, unknown[:1], float(declared.gain), numerators)

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
