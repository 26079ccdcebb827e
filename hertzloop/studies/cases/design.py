"""The cases of a study: a grid, or points spread over ranges, of any scene keys."""

import itertools
import json
import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy

from hertzloop.scene.errors import SceneError, shortened, shown
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import toml_value
from hertzloop.studies.worst.of_case import WORST_OF

Kind = Literal["grid", "lhs", "sobol"]
Range = str | Iterable[Any]  # "low:high:step", "low:high", "a,b,c", or values
_MOST_CASES = 10_000_000
_LAW = "controller.law"


class DesignError(ValueError):
    """The ranges of a sweep cannot be used. The message names the key and the remedy."""

    exit_status = 2


@dataclass(frozen=True)
class Axis:
    """A scene key and its values.

    Attributes:
        key: The scene key.
        values: Its values; empty for a range that points are spread over.
        low: Lower end of the range.
        high: Upper end of the range.
        resolution: Distance of the values in the range; 0 for any number.
    """

    key: str
    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    resolution: float = 0.0

    def at(self, share: float) -> Any:
        """Return the value at a share in [0, 1) of the axis."""
        if self.values:
            return self.values[int(share * len(self.values))]
        if self.resolution:
            places = math.floor((self.high - self.low) / self.resolution + 1e-9) + 1
            return self.at_resolution(self.low + int(share * places) * self.resolution)
        return self.low + share * (self.high - self.low)

    def at_resolution(self, value: float) -> Any:
        """Return the possible value that is nearest to a number."""
        return on_resolution(value, self.resolution, self.low)


def on_resolution(value: float, resolution: float, low: float = 0.0) -> Any:
    """Return the nearest of the numbers `resolution` apart, from `low` on; 0: any number."""
    if not resolution:
        return value
    near = low + round((value - low) / resolution) * resolution
    return round(near) if resolution == round(resolution) else float(f"{near:.12g}")


def fitted(axis: Axis, setup: Setup) -> Axis:
    """Return the axis with the resolution of its key in a scene."""
    return axis if axis.values else replace(axis, resolution=setup.resolution_of(axis.key))


def parse_axis(text: str) -> Axis:
    """Read `key=low:high:step` (both ends included), `key=low:high` (for spread points), or
    `key=a,b,c`. Raises DesignError.
    """
    key, equals, given = (part.strip() for part in text.partition("="))
    if not equals or not given or not all(key.split(".")):
        raise DesignError(
            f"--over {shown(text)}: invalid range. Write key=low:high:step or key=a,b,c, as in "
            "controller.latency_us=0:100:1."
        )
    parts = given.split(":")
    if len(parts) == 1:
        items = _items(given)
        if "" in items:
            raise DesignError(f"{shown(text)} has an empty value. Remove one comma.")
        return Axis(key, tuple(toml_value(value) for value in items))
    numbers = [toml_value(part) for part in parts]
    if len(parts) > 3 or not all(_is_number(x) for x in numbers):
        raise DesignError(
            f"{shown(text)}: the range must consist of numbers. Write "
            f"{shortened(key)}=low:high:step."
        )
    low, high = numbers[0], numbers[1]
    if not low <= high:
        raise DesignError(f"{shown(text)}: the first number must be the lower one. Swap them.")
    if len(parts) == 2:
        return Axis(key, (), float(low), float(high))
    step = numbers[2]
    if not step > 0:
        raise DesignError(f"{shown(text)} has a step of {shown(step)}. Give a step above 0.")
    places = (float(high) - float(low)) / step + 1e-9  # inf where they cannot be counted
    if not places < _MOST_CASES:
        raise DesignError(
            f"{shown(text)} has {places + 1:.8g} values; the limit is {_MOST_CASES}. "
            "Give a larger step."
        )
    count = math.floor(places) + 1
    if all(isinstance(x, int) for x in numbers):
        return Axis(key, tuple(low + i * step for i in range(count)))
    return Axis(key, tuple(float(f"{low + i * step:.12g}") for i in range(count)))


def _is_number(value: Any) -> bool:
    """Whether a value is a number that a float can hold."""
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:
        return False


def _items(text: str) -> list[str]:
    """Split a text at commas outside of brackets."""
    items, depth = [""], 0
    for letter in text:
        depth += (letter == "[") - (letter == "]")
        if letter == "," and depth == 0:
            items.append("")
        else:
            items[-1] += letter
    return [item.strip() for item in items]


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
        worst: Metric whose worst latencies each case searches; "" for none.
    """

    axes: tuple[Axis, ...]
    kind: Kind = "grid"
    count: int = 0
    seed: int = 1
    drawn_keys: tuple[str, ...] = ()
    drawn: tuple[tuple[float, ...], ...] = ()
    worst: str = ""

    @property
    def keys(self) -> list[str]:
        """The keys that differ from case to case."""
        return [axis.key for axis in self.axes] + list(self.drawn_keys)

    def cases(self) -> list[dict[str, Any]]:
        """Return values by scene key, one dictionary for each case, always in the same order: the
        draws change fastest, then the last axis."""
        searched = {WORST_OF: self.worst} if self.worst else {}
        return [
            case | dict(zip(self.drawn_keys, row, strict=True)) | searched
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


def toml_text(value: Any) -> str:
    """Return a value of a scene key as TOML text."""
    return value if isinstance(value, str) else json.dumps(value)


def keys_of(design: Mapping[str, Any]) -> list[str]:
    """Return the keys that differ from case to case, from a design in a file of results."""
    return [axis["key"] for axis in design["axes"]] + list(design.get("drawn_keys", ()))


def axes_from(over: Mapping[str, Range] | Iterable[str], option: str = "--over") -> list[Axis]:
    """Return axes from ranges by key, or from texts as in `parse_axis`.

    Raises:
        DesignError: a range cannot be used, or a key is given twice.
    """
    if isinstance(over, Mapping):
        return [as_axis(key, values) for key, values in over.items()]
    axes = [parse_axis(text) for text in over]
    check_keys(axes, option)
    return axes


def as_axis(key: str, values: Range) -> Axis:
    """Return an axis from values of a key, or from a range as in `parse_axis`.

    Raises:
        DesignError: there are no values, or the range cannot be used.
    """
    if isinstance(values, str):
        return parse_axis(f"{key}={values}")
    given = tuple(v.item() if isinstance(v, np.generic) else v for v in values)
    if not given:
        raise DesignError(f"{shown(key)} has no values. Give at least one.")
    return Axis(key, given)


def check_keys(axes: Iterable[Axis], option: str = "--over") -> None:
    """Refuse a key that is given twice. Raises DesignError."""
    keys = [axis.key for axis in axes]
    for key in keys:
        if keys.count(key) > 1:
            raise DesignError(
                f"{option} {shortened(key)} is given twice. Put its values into one list."
            )


def design_of(setup: Setup, over: list[Axis], kind: Kind, count: int, seed: int) -> Design:
    """Return a design whose axes fit a scene.

    Raises:
        DesignError: the axes, or their kind and the number of points, do not go together.
        SceneError: the scene refuses a key, or an end of a range.
    """
    axes = tuple(fitted(axis, setup) for axis in over)
    if not axes:
        raise DesignError("a sweep needs at least one --over, e.g. controller.latency_us=0:100:1")
    check_keys(axes)
    design = Design(axes, kind, count, seed)
    if kind == "grid":
        for axis in axes:
            if not axis.values:
                raise DesignError(
                    f"--over {shortened(axis.key)}={axis.low:g}:{axis.high:g} has no step. Add a "
                    "step, or use --design sobol or lhs."
                )
        size = math.prod(len(axis.values) for axis in axes)
        if size > _MOST_CASES:
            raise DesignError(
                f"the grid has {shown(size)} cases; the limit is {_MOST_CASES}. Use larger steps."
            )
    elif not 1 <= count <= _MOST_CASES:
        raise DesignError(f"--cases = {count}; --design {kind} needs 1 to {_MOST_CASES}")
    _check_ends(setup, design)
    return design


def _check_ends(setup: Setup, design: Design) -> None:
    """Refuse a key or an end of a range before hours of work. Each law of the design is tried,
    since a key may belong to some laws only."""
    first = {axis.key: axis.at(0.0) for axis in design.axes}
    laws = next((axis.values for axis in design.axes if axis.key == _LAW), ())
    for law in [{_LAW: law} for law in laws] or [{}]:
        for axis in design.axes:
            ends = (axis.values[0], axis.values[-1]) if axis.values else (axis.low, axis.high)
            for value in ends if axis.key != _LAW else law.values():
                try:
                    setup.vary({**first, **law, axis.key: value})
                except SceneError as error:
                    where = f"--over {shortened(axis.key)}, value {shown(value)}"
                    raise SceneError(f"{where}: {error}") from error
