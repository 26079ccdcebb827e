"""What is known of a measurement: the keys of a `[record]` table."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.quantities import NAMES
from hertzloop.sensors.acquisition import HIGHEST_ORDER

Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
ColumnChoice = str | Annotated[int, Field(strict=True, ge=1)]


@dataclass(frozen=True)
class Measurement:
    """The `[record]` table: what is known of a measurement.

    Attributes:
        quantity: what the values are, a key of `QUANTITIES`.
        unit: of the values; "" if the name of the column states it.
        column: which column of the file holds the values, by its name or its number from 1 on.
        time_column: the same of the times.
        time_unit: of the times; "" if the name of the column states it.
        rate_hz: samples per second of a file without times.
        decimal: decimal sign of a text file.
        sensitivity: units of the file for one `unit`, for example V for one N.
        sensitivity_uncertainty: its relative standard deviation; inf if it is unknown.
        clock_tolerance_ppm: standard deviation of the clock's relative error.
        low_pass_hz, low_pass, low_pass_order, ac_coupling_hz, resonance_hz, resonance_damping:
            filters of the measuring chain.
        range: lowest and highest value of the converter, in the unit of the file.
        bits: of the converter.
        point_m: measuring point, m.
        set: scene keys that hold for this record only, such as its drop height.
        control: whether the law was on; if None, it was where the quantity is the force of the
            actuator, or a key of the law is free.
    """

    quantity: str | None = None
    unit: str = ""
    column: ColumnChoice | None = None
    time_column: ColumnChoice | None = None
    time_unit: str = ""
    rate_hz: Positive | None = None
    decimal: Literal[".", ","] = "."
    sensitivity: Finite = 1.0
    sensitivity_uncertainty: Annotated[float, Field(strict=True, ge=0.0)] = 0.03
    clock_tolerance_ppm: Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)] = 50.0
    low_pass_hz: Positive | None = None
    low_pass: Literal["butterworth", "bessel", "sigma-delta"] = "butterworth"
    low_pass_order: Annotated[int, Field(strict=True, ge=1, le=HIGHEST_ORDER)] = 1
    ac_coupling_hz: Positive | None = None
    resonance_hz: Positive | None = None
    resonance_damping: Positive = 0.02
    range: tuple[Finite, Finite] | None = None
    bits: Annotated[int, Field(strict=True, ge=1, le=64)] | None = None
    point_m: tuple[Finite, Finite] | None = None
    set: Mapping[str, Any] = field(default_factory=dict)
    control: Annotated[bool, Field(strict=True)] | None = None

    __pydantic_config__ = ConfigDict(extra="forbid")

    @property
    def filtered(self) -> bool:
        """Whether the table names a filter."""
        return any(
            f is not None for f in (self.low_pass_hz, self.ac_coupling_hz, self.resonance_hz)
        )


KEYS = tuple(one.name for one in fields(Measurement))
_CHECKED = TypeAdapter(Measurement)


def parse_record_table(table: Mapping[str, Any], name: str) -> Measurement:
    """Return a `[record]` table as an object, with the standard name of its quantity.

    Raises:
        RecordError: a key or a value is wrong.
    """
    for key in table:
        if key not in KEYS:
            raise RecordError(
                f"record.{key}: not a key of the record table of {name}. Known keys: "
                f"{', '.join(sorted(KEYS))}."
            )
    try:
        found = _CHECKED.validate_python(dict(table))
    except ValidationError as error:
        first = error.errors()[0]
        wrong = str(first["loc"][0])
        raise RecordError(f"record.{wrong} = {table[wrong]}: {first['msg']} in {name}.") from None
    _check_together(found, table, name)
    quantity = found.quantity
    return replace(found, quantity=NAMES.get(quantity, quantity) if quantity else None)


def _check_together(found: Measurement, table: Mapping[str, Any], name: str) -> None:
    """Raise RecordError for keys that need another key, or contradict each other."""
    if found.sensitivity == 0.0:
        raise RecordError(f"record.sensitivity = 0: must not be zero in {name}.")
    if found.range is not None and not found.range[0] < found.range[1]:
        raise RecordError(f"record.range = {list(found.range)}: must rise in {name}.")
    if found.low_pass == "sigma-delta" and "low_pass_order" in table:
        raise RecordError(
            f"record.low_pass_order = {found.low_pass_order}: a sigma-delta converter has no order "
            f"in {name}. Leave it out."
        )
    for key, needed in (
        ("low_pass", "low_pass_hz"),
        ("low_pass_order", "low_pass_hz"),
        ("resonance_damping", "resonance_hz"),
        ("bits", "range"),
    ):
        if key in table and getattr(found, needed) is None:
            raise RecordError(
                f"record.{key} = {table[key]}: has no meaning without record.{needed} in {name}. "
                f"Give record.{needed}."
            )
