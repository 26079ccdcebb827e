"""A metric is one row, from which tables, pictures, JSON, files and the reference page are made."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

# A metric is one row: tables, pictures, JSON, files and the reference page are made of it.
Kind = TypeVar("Kind", bound=type)


@dataclass(frozen=True)
class MetricField:
    """A metric.

    Attributes:
        meaning: what it is, with its unit.
        words: heading in tables and pictures, without unit; "" where it has none.
        unit: the unit there.
        factor: from the value to that unit.
        db: factor of the logarithm of its ratio in dB, 0 of one that is compared in per cent.
        of: what makes the value of what the metrics are taken from, or the path of an attribute.
        shown: whether the command and the report show it without being asked.
        without: the value without control.
        difference: whether two values are compared by their difference: a number, or a value
            that may change its sign.
        less_is_better: whether control is to make it smaller.
    """

    meaning: str
    words: str = ""
    unit: str = ""
    factor: float = 1.0
    db: float = 0.0
    of: Callable[[Any], Any] | str = ""
    shown: bool = False
    without: float = 0.0
    difference: bool = False
    less_is_better: bool = False


def metric(*about: Any, **more: Any) -> Any:
    """A field of a dataclass of metrics; arguments as in `MetricField`."""
    return field(metadata={"metric": MetricField(*about, **more)})


def fields_of(kind: type) -> dict[str, MetricField]:
    """The metrics of a dataclass by name."""
    return {one.name: one.metadata["metric"] for one in fields(kind)}


def described(kind: Kind) -> Kind:
    """A dataclass of metrics whose docstring says what each is."""
    told = (f"        {name}: {row.meaning}." for name, row in fields_of(kind).items())
    kind.__doc__ = f"{kind.__doc__}\n    Attributes:\n" + "\n".join(told) + "\n    "
    return kind
