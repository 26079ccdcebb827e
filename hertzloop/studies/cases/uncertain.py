"""Scene keys that are not known exactly: their distributions, and draws from these.

Cases are drawn by (seed, number), so that a longer run begins with the cases of a shorter one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.axis import on_resolution
from hertzloop.studies.cases.design import Design

_STREAM = 11  # random stream of the draws; noise, jitter, drop-outs and touch phase have others
_NORMAL = NormalDist()


@dataclass(frozen=True)
class UncertainInput:
    """One scene key with a distribution, or the keys that a fit found together.

    Attributes:
        keys: the scene keys.
        kind: normal, log_normal, uniform, triangular, values, or fitted (the logarithms are
            correlated).
        numbers: of the distribution, in the unit of the key, in the order of the documentation of
            the file; the measured values; or the medians of fitted keys.
        factor: of fitted keys, a square root of the covariance of their logarithms, rows as `keys`.
        resolutions: how far apart the values of each key are, 0 for any number.
    """

    keys: tuple[str, ...]
    kind: str
    numbers: tuple[float, ...]
    factor: tuple[tuple[float, ...], ...] = ()
    resolutions: tuple[float, ...] = (0.0,)

    def at(self, shares: Sequence[float]) -> dict[str, Any]:
        """Return the values at a point of the unit cube, one number in (0, 1) a key."""
        found = self._fitted(shares) if self.factor else [self._single(shares[0])]
        return {
            key: on_resolution(value, resolution)
            for key, value, resolution in zip(self.keys, found, self.resolutions, strict=True)
        }

    def _fitted(self, shares: Sequence[float]) -> list[float]:
        away = np.array(self.factor) @ [_NORMAL.inv_cdf(share) for share in shares]
        return [float(x) for x in self.numbers * np.exp(away)]

    def _single(self, share: float) -> float:
        one = self.numbers
        if self.kind == "normal":
            return one[0] + one[1] * _NORMAL.inv_cdf(share)
        if self.kind == "log_normal":
            return one[0] * math.exp(one[1] * _NORMAL.inv_cdf(share))
        if self.kind == "uniform":
            return one[0] + share * (one[1] - one[0])
        if self.kind == "triangular":
            low, mode, high = one
            below = (mode - low) / (high - low)
            if share < below:
                return low + math.sqrt(share * (high - low) * (mode - low))
            return high - math.sqrt((1.0 - share) * (high - low) * (high - mode))
        return one[min(int(share * len(one)), len(one) - 1)]


@dataclass(frozen=True)
class UncertainInputs:
    """All uncertain keys of a scene."""

    parts: tuple[UncertainInput, ...]

    @property
    def keys(self) -> list[str]:
        """The keys, in order."""
        return [key for part in self.parts for key in part.keys]

    def at(self, point: Sequence[float]) -> dict[str, Any]:
        """Return the values at a point of the unit cube, shape (keys,)."""
        found: dict[str, Any] = {}
        place = 0
        for part in self.parts:
            found |= part.at(point[place : place + len(part.keys)])
            place += len(part.keys)
        return found

    def draw(self, seed: int, number: int) -> dict[str, Any]:
        """Return case `number`: a function of the seed and this number alone. Its noise, jitter and
        drop-outs have a seed of their own, unless the file gives `run.seed` a distribution."""
        bits = np.random.Philox(key=[seed, _STREAM], counter=[0, 0, number, 0])
        point = np.random.Generator(bits).random(len(self.keys))
        own = {"run.seed": seed + number}
        return own | self.at([min(max(float(x), 1e-15), 1.0 - 1e-15) for x in point])


def with_draws(setup: Setup, design: Design, uncertain: UncertainInputs, count: int) -> Design:
    """Return a design whose every case runs with each of `count` draws.

    Args:
        setup: the scene; its seed decides the draws.
        design: the cases, for example `Design(())` for the scene alone.
        uncertain: the distributions.
        count: number of draws.

    Raises:
        SceneError: the design varies an uncertain key, or the scene refuses a drawn value.
    """
    drawn = [uncertain.draw(setup.run.seed, number) for number in range(count)]
    for key in drawn[0]:
        if key in design.keys:
            raise SceneError(f"--over {key}: is drawn by --uncertain. Leave one of them out")
    for case in drawn:
        setup.vary(case)
    rows = tuple(tuple(case.values()) for case in drawn)
    return replace(design, drawn_keys=tuple(drawn[0]), drawn=rows)
