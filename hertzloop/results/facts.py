"""A fact is a number that a run, an impact or a case of a sweep has: one row says all about it.

Tables, verdict, JSON, files, charts, goals and the reference page are made of the rows. A fact is
added by one field `fact(...)` of `SpanMetrics` or `CaseMetrics`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, Literal, TypeVar

from hertzloop.plant.state_kernels import GRAVITY_M_S2

Kind = TypeVar("Kind", bound=type)
# From value, model error (relative) and impact speed (m/s) to the absolute error of the value.
ModelError = Callable[[float, float, float], float]


class Level(IntEnum):
    """Where a fact is shown: always, with the details, or in data and `compare --details` alone."""

    BRIEF = 0
    DETAILS = 1
    DATA = 2


def exact(value: float, model_error: float, impact_speed_m_s: float) -> float:
    """Error of what does not depend on the modes."""
    return 0.0


def share(value: float, model_error: float, impact_speed_m_s: float) -> float:
    """Error as a share of the value."""
    return model_error * abs(value)


def of_speed(value: float, model_error: float, impact_speed_m_s: float) -> float:
    """Error of a speed as a share of the impact speed."""
    return model_error * impact_speed_m_s


def of_height(value: float, model_error: float, impact_speed_m_s: float) -> float:
    """Error of a height whose speed has such an error."""
    speed, wrong = math.sqrt(2.0 * GRAVITY_M_S2 * max(value, 0.0)), model_error * impact_speed_m_s
    return ((speed + wrong) ** 2 - speed**2) / (2.0 * GRAVITY_M_S2)


@dataclass(frozen=True)
class Fact:
    """A number.

    Attributes:
        meaning: what it is, with its unit.
        label: its name in tables, sentences and charts; "" where it has none.
        unit: its unit there.
        db: factor of the logarithm of its ratio in dB, 0 of one that is compared in per cent.
        of: how it is computed: in `SpanMetrics` from `SpanParts` (`span_metrics.py`), in
            `CaseMetrics` from `_Case` (`cases.py`). None in `SpanMetrics`: it is the metric of
            `ImpactNoise` with the name of the field.
        level: where it is shown.
        whole_run: where its value over the whole run is shown.
        error: what the error of the model does to it.
        impacts: the impacts of a whole run that decide it, and its error.
        without: the value without control.
        difference: whether two values are compared by their difference: a number, or a value
            that may change its sign.
        less_is_better: whether control is to make it smaller.
    """

    meaning: str
    label: str = ""
    unit: str = ""
    db: float = 0.0
    of: Callable[[Any], Any] | None = None
    level: Level = Level.DATA
    whole_run: Level = Level.DATA
    error: ModelError = share
    impacts: Literal["first", "last", "largest", "all"] = "all"
    without: float = 0.0
    difference: bool = False
    less_is_better: bool = False


def fact(*about: Any, **more: Any) -> Any:
    """A field of a dataclass of facts; arguments as in `Fact`."""
    return field(metadata={"fact": Fact(*about, **more)})


def facts_of(kind: type) -> dict[str, Fact]:
    """The facts of a dataclass by name."""
    return {one.name: one.metadata["fact"] for one in fields(kind)}


def described(kind: Kind) -> Kind:
    """A dataclass of facts whose docstring says what each is."""
    told = (f"        {name}: {row.meaning}." for name, row in facts_of(kind).items())
    kind.__doc__ = f"{kind.__doc__}\n    Attributes:\n" + "\n".join(told) + "\n    "
    return kind
