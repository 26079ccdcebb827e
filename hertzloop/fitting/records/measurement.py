"""What is known of a measurement: the keys of a `[record]` table."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np

from hertzloop.fitting.records.chain_keys import LOW_PASSES
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.quantities import NAMES
from hertzloop.sensors.acquisition import HIGHEST_ORDER

DEFAULT_GAIN_UNCERTAINTY = 0.03
DEFAULT_CLOCK_PPM = 50.0


@dataclass(frozen=True)
class Measurement:
    """The `[record]` table: what is known of a measurement.

    `quantity`, `unit`: what the values are. `column`, `channel`: which column or channel of the
    file holds them, by its name or its number from 1 on; `group`: of which group or table.
    `time_column`, `time_unit`: the same of the times.
    `sensitivity`: units of the file for one unit of `unit`, e.g. V for N (1 if left out), and
    `sensitivity_uncertainty`, relative standard deviation (inf if it is unknown). `rate_hz`: where
    the file has no times.
    `clock_tolerance_ppm`: standard deviation of the clock's relative error. `low_pass_hz`,
    `low_pass`, `low_pass_order`, `ac_coupling_hz`, `resonance_hz`, `resonance_damping`: filters of
    the measuring chain.
    `range`, `bits`: of the converter; the range in the unit of the file. `point_m`: measuring
    point, m. `set`: scene keys that hold for this record only, such as its drop height. `control`:
    whether the law was on; if left out, it was where the force of the actuator is the quantity or
    has a free key. `clock`: a name that channels of one drop share which were sampled by one clock;
    channels of one file with equal times share it unless another one is named.
    """

    quantity: str | None = None
    unit: str | None = None
    column: str | int | None = None
    channel: str | int | None = None
    group: str | int | None = None
    time_column: str | int | None = None
    time_unit: str | None = None
    sensitivity: float = 1.0
    sensitivity_uncertainty: float = DEFAULT_GAIN_UNCERTAINTY
    rate_hz: float | None = None
    clock_tolerance_ppm: float = DEFAULT_CLOCK_PPM
    low_pass_hz: float | None = None
    ac_coupling_hz: float | None = None
    resonance_hz: float | None = None
    resonance_damping: float = 0.02
    range: tuple[float, float] | None = None
    bits: int | None = None
    point_m: tuple[float, float] | None = None
    set: Mapping[str, Any] = field(default_factory=dict)
    control: bool | None = None
    clock: str | None = None
    low_pass: str = "butterworth"
    low_pass_order: int = 1

    @property
    def filtered(self) -> bool:
        """Whether the table names a filter."""
        return any(
            f is not None for f in (self.low_pass_hz, self.ac_coupling_hz, self.resonance_hz)
        )


def parse_record_table(table: Mapping[str, Any], name: str) -> Measurement:
    """Return a `[record]` table as an object, with the standard name of its quantity.

    Raises:
        RecordError: a key or a value is wrong.
    """
    values = dict(table)
    for key, value in values.items():
        if key not in _RULES:
            raise RecordError(
                f"record.{key}: not a key of the record table of {name}. Known keys: "
                f"{', '.join(sorted(_RULES))}."
            )
        if not _RULES[key].holds(value):
            raise RecordError(f"record.{key} = {value}: must be {_RULES[key].wanted} in {name}.")
    for key in ("range", "point_m"):
        if key in values:
            low, high = values[key]
            values[key] = float(low), float(high)
    if "quantity" in values:
        values["quantity"] = NAMES.get(values["quantity"], values["quantity"])
    found = Measurement(**values)
    if found.low_pass == "sigma-delta" and "low_pass_order" in values:
        raise RecordError(
            f"record.low_pass_order = {found.low_pass_order}: a sigma-delta converter has no order "
            f"in {name}. Leave it out."
        )
    named = next((key for key in ("low_pass", "low_pass_order") if key in values), None)
    if named and found.low_pass_hz is None:
        raise RecordError(
            f"record.{named} = {values[named]}: has no corner in {name}. Give record.low_pass_hz."
        )
    if "resonance_damping" in values and found.resonance_hz is None:
        raise RecordError(
            f"record.resonance_damping = {found.resonance_damping}: has no resonance in {name}. "
            "Give record.resonance_hz."
        )
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: Any, most: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and 1 <= int(value) <= most


def _is_pair(value: Any) -> bool:
    two = isinstance(value, list | tuple | np.ndarray) and len(value) == 2
    return two and all(_is_number(one) and math.isfinite(one) for one in value)


class _Rule(NamedTuple):
    """What the value of a key must be: the test, and words on it."""

    holds: Callable[[Any], bool]
    wanted: str


_NAME = _Rule(lambda value: isinstance(value, str), "a name")
_NAME_OR_NUMBER = _Rule(
    lambda value: isinstance(value, str | int) and not isinstance(value, bool),
    "a name or a number from 1 on",
)
_POSITIVE = _Rule(lambda value: _is_number(value) and 0.0 < value < math.inf, "a positive number")
_RULES = {
    "quantity": _NAME,
    "unit": _NAME,
    "column": _NAME_OR_NUMBER,
    "channel": _NAME_OR_NUMBER,
    "group": _NAME_OR_NUMBER,
    "time_column": _NAME_OR_NUMBER,
    "time_unit": _NAME,
    "sensitivity": _Rule(
        lambda value: _is_number(value) and math.isfinite(value) and value != 0.0,
        "a number other than zero",
    ),
    "sensitivity_uncertainty": _Rule(
        lambda value: _is_number(value) and value >= 0.0, "zero, a positive number or inf"
    ),
    "rate_hz": _POSITIVE,
    "clock_tolerance_ppm": _Rule(
        lambda value: _is_number(value) and 0.0 <= value < math.inf, "zero or a positive number"
    ),
    "low_pass_hz": _POSITIVE,
    "low_pass": _Rule(lambda value: value in LOW_PASSES, f"one of {', '.join(LOW_PASSES)}"),
    "low_pass_order": _Rule(
        lambda value: _is_whole(value, HIGHEST_ORDER), f"a whole number from 1 to {HIGHEST_ORDER}"
    ),
    "ac_coupling_hz": _POSITIVE,
    "resonance_hz": _POSITIVE,
    "resonance_damping": _POSITIVE,
    "range": _Rule(
        lambda value: _is_pair(value) and bool(value[0] < value[1]), "two rising numbers"
    ),
    "bits": _Rule(lambda value: _is_whole(value, 64), "a whole number from 1 to 64"),
    "point_m": _Rule(_is_pair, "two numbers"),
    "set": _Rule(lambda value: isinstance(value, Mapping), "a table of scene keys"),
    "control": _Rule(lambda value: isinstance(value, bool), "true or false"),
    "clock": _NAME,
}
