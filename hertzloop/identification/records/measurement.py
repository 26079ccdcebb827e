"""What is known of a measurement: the keys of a `[record]` table."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from hertzloop.identification.records.chain_keys import LOW_PASSES
from hertzloop.identification.records.errors import RecordError
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
    `range`, `bits`: of the converter, in `unit`. `point_m`: measuring point, m. `set`: scene keys
    that hold for this record only, such as its drop height. `control`: whether the law was on; if
    left out, it was where the force of the actuator is the quantity or has a free key. `clock`: a
    name that channels of one drop share which were sampled by one clock; channels of one file with
    equal times share it unless another one is named.
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
    """Return a `[record]` table as an object. Raises RecordError for a wrong key or value."""
    known = {part.name for part in fields(Measurement)}
    for key in table:
        if key not in known:
            raise RecordError(
                f"record.{key}: not a key of the record table of {name}. Known keys: "
                f"{', '.join(sorted(known))}."
            )
    values = dict(table)
    for key in ("range", "point_m"):
        if key in values:
            try:
                low, high = (float(x) for x in values[key])
            except (TypeError, ValueError) as error:
                raise RecordError(f"record.{key} = {values[key]}: must be two numbers.") from error
            values[key] = (low, high)
    numbers = (
        "sensitivity",
        "sensitivity_uncertainty",
        "rate_hz",
        "clock_tolerance_ppm",
        "low_pass_hz",
        "ac_coupling_hz",
        "resonance_hz",
        "resonance_damping",
    )
    for key in numbers:
        if key not in values:
            continue
        value = values[key]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        least_ok = key in ("sensitivity_uncertainty", "clock_tolerance_ppm")
        finite = number and (
            math.isfinite(value) or (key == "sensitivity_uncertainty" and value > 0)
        )
        good = finite and (value >= 0 if least_ok else value != 0)
        if not good or (key != "sensitivity" and value < 0):
            raise RecordError(f"record.{key} = {value}: must be a positive number in {name}.")
    places = [
        (key, (str, int), "a name or a number from 1 on")
        for key in ("column", "channel", "group", "time_column")
    ]
    names = [(key, (str,), "a name") for key in ("clock", "unit", "time_unit")]
    for key, kind, what in (("control", (bool,), "true or false"), *names, *places):
        wrong = isinstance(values.get(key), bool) and kind != (bool,)
        if key in values and (wrong or not isinstance(values[key], kind)):
            raise RecordError(f"record.{key} = {values[key]}: must be {what} in {name}.")
    found = Measurement(**values)
    if found.low_pass not in LOW_PASSES:
        raise RecordError(
            f"record.low_pass = '{found.low_pass}': not known in {name}. Give one of "
            f"{', '.join(LOW_PASSES)}."
        )
    order = found.low_pass_order
    if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= HIGHEST_ORDER:
        raise RecordError(
            f"record.low_pass_order = {order}: must be a whole number from 1 to {HIGHEST_ORDER} "
            f"in {name}."
        )
    if found.low_pass == "sigma-delta" and "low_pass_order" in values:
        raise RecordError(
            f"record.low_pass_order = {order}: a sigma-delta converter in {name} has no order. "
            "Leave it out."
        )
    named = next((key for key in ("low_pass", "low_pass_order") if key in values), None)
    if named and found.low_pass_hz is None:
        raise RecordError(
            f"record.{named} = {values[named]}: has no corner in {name}. Give record.low_pass_hz."
        )
    return found
