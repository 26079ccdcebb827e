"""The cases of a study: a grid, or points spread over ranges, of any scene keys."""

import itertools
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy

from hertzloop.scene.errors import SceneError, shortened, shown
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.axis import MOST_CASES, Axis, DesignError, fitted

DesignKind = Literal["grid", "lhs", "sobol"]
_LAW = "controller.law"


@dataclass(frozen=True)
class Design:
    """Cases: all combinations of axes, or points spread over them, each with all draws.

    Attributes:
        axes: The axes.
        kind: "grid" for all combinations; "lhs" or "sobol" for spread points.
        count: Number of spread points.
        seed: Random seed of the spread points.
        drawn_keys: Scene keys that are drawn.
        drawn: Values of these keys, shape (draws, keys).
    """

    axes: tuple[Axis, ...]
    kind: DesignKind = "grid"
    count: int = 0
    seed: int = 1
    drawn_keys: tuple[str, ...] = ()
    drawn: tuple[tuple[float, ...], ...] = ()

    @property
    def keys(self) -> list[str]:
        """The keys that differ from case to case."""
        return [axis.key for axis in self.axes] + list(self.drawn_keys)

    def cases(self) -> list[dict[str, Any]]:
        """Return values by scene key, one dictionary for each case, always in the same order: the
        draws change fastest, then the last axis."""
        return [
            case | dict(zip(self.drawn_keys, row, strict=True))
            for case in self._of_axes()
            for row in self.drawn or [()]
        ]

    def _of_axes(self) -> list[dict[str, Any]]:
        keys = [axis.key for axis in self.axes]
        if self.kind == "grid":
            every = itertools.product(*(axis.values for axis in self.axes))
            return [dict(zip(keys, values, strict=True)) for values in every]
        qmc = scipy.stats.qmc  # loading it takes half a second, and a grid does not need it
        sampler: Any = qmc.Sobol if self.kind == "sobol" else qmc.LatinHypercube
        spread = sampler(len(self.axes), rng=np.random.default_rng(self.seed))
        with warnings.catch_warnings():  # Sobol points are balanced best by powers of 2
            warnings.simplefilter("ignore", UserWarning)
            points = spread.random(self.count)
        return [
            {axis.key: axis.at(float(x)) for axis, x in zip(self.axes, point, strict=True)}
            for point in points
        ]


def keys_of(design: Mapping[str, Any]) -> list[str]:
    """Return the keys that differ from case to case, from a design in a file of results."""
    return [axis["key"] for axis in design["axes"]] + list(design["drawn_keys"])


def design_of(setup: Setup, over: list[Axis], kind: DesignKind, count: int, seed: int) -> Design:
    """Return a design whose axes fit a scene.

    Raises:
        DesignError: the axes, or their kind and the number of points, do not go together.
        SceneError: the scene refuses a key, or an end of a range.
    """
    axes = tuple(fitted(axis, setup) for axis in over)
    if not axes:
        raise DesignError("a sweep needs at least one --over, e.g. controller.latency_us=0:100:1")
    design = Design(axes, kind, count, seed)
    if kind == "grid":
        for axis in axes:
            if not axis.values:
                raise DesignError(
                    f"--over {shortened(axis.key)}={axis.low:g}:{axis.high:g} has no step. Add a "
                    "step, or use --design sobol or lhs."
                )
        size = math.prod(len(axis.values) for axis in axes)
        if size > MOST_CASES:
            raise DesignError(
                f"the grid has {shown(size)} cases; the limit is {MOST_CASES}. Use larger steps."
            )
    elif not 1 <= count <= MOST_CASES:
        raise DesignError(f"--cases = {count}; --design {kind} needs 1 to {MOST_CASES}")
    _check_ends(setup, design)
    return design


def _check_ends(setup: Setup, design: Design) -> None:
    """Refuse a key, an end of a range or its step before hours of work. Each law of the design is
    tried, since a key may belong to some laws only."""
    first = {axis.key: axis.at(0.0) for axis in design.axes}
    laws = next((axis.values for axis in design.axes if axis.key == _LAW), ())
    for law in [{_LAW: law} for law in laws] or [{}]:
        for axis in design.axes:
            ends = (*axis.values[:2], axis.values[-1]) if axis.values else (axis.low, axis.high)
            for value in ends if axis.key != _LAW else law.values():
                try:
                    setup.vary({**first, **law, axis.key: value})
                except SceneError as error:
                    where = f"--over {shortened(axis.key)}, value {shown(value)}"
                    raise SceneError(f"{where}: {error}") from error
