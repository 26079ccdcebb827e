"""A scene key with its values or its range, read from text or from Python values."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.scene.errors import shortened, shown
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import toml_value

Range = str | Iterable[Any]  # "low:high:step", "low:high", "a,b,c", or values
MOST_CASES = 10_000_000


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
    if not places < MOST_CASES:
        raise DesignError(
            f"{shown(text)} has {places + 1:.8g} values; the limit is {MOST_CASES}. "
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


def axes_from(over: Mapping[str, Range] | Iterable[str], option: str = "--over") -> list[Axis]:
    """Return axes from ranges by key, or from texts as in `parse_axis`.

    Raises:
        DesignError: a range cannot be used, or a key is given twice.
    """
    if isinstance(over, Mapping):
        return [as_axis(key, values) for key, values in over.items()]
    axes = [parse_axis(text) for text in over]
    keys = [axis.key for axis in axes]
    for key in keys:
        if keys.count(key) > 1:
            raise DesignError(
                f"{option} {shortened(key)} is given twice. Put its values into one list."
            )
    return axes


def as_axis(key: str, values: Range) -> Axis:
    """Return an axis from values of a key, or from a range as in `parse_axis`.

    Raises:
        DesignError: there are no values, or the range cannot be used.
    """
    if isinstance(values, str):
        return parse_axis(f"{key}={values}")
    if not isinstance(values, Iterable):
        raise DesignError(f"{shown(key)} = {shown(values)}: must be a list of values. Write one.")
    given = tuple(v.item() if isinstance(v, np.generic) else v for v in values)
    if not given:
        raise DesignError(f"{shown(key)} has no values. Give at least one.")
    return Axis(key, given)
