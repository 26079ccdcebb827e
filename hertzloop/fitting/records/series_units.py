"""Units of a series: what the file states, what the `[record]` table says, and the factor to SI."""

import math
from collections.abc import Collection
from dataclasses import replace

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import NAMES, QUANTITIES
from hertzloop.fitting.records.units import name_and_unit, plain_name, unit_of

_EXAMPLES = {
    "N": "N, kN, mN, lbf",
    "m/s": "m/s, mm/s, um/s, in/s",
    "m/s^2": "m/s^2, g, mm/s^2",
    "m": "m, mm, um, nm",
}


def resolve_unit(
    series: Series,
    quantity: str,
    contents: FileContents,
    measurement: Measurement,
    sensitivity_given: bool,
) -> tuple[Measurement, str, list[str]]:
    """Find the unit of a series.

    Args:
        series: the record.
        quantity: what it measures.
        contents: of the file.
        measurement: the `[record]` table.
        sensitivity_given: whether the table states a sensitivity.

    Returns:
        The table with the unit that the file states, words on the unit, and notes.

    Raises:
        RecordError: the unit is not known, or not of this quantity.
    """
    name, stated = contents.name, _stated_unit(series, contents)
    unit, si = unit_of(stated), QUANTITIES[quantity].unit
    unknown = measurement.sensitivity_uncertainty == math.inf
    if contents.multiplier not in ("", "1", "1.0") and not sensitivity_given:
        raise RecordError(
            f"{name}: states a factor of its values, '{contents.multiplier}', which may be part of "
            "them or not. Give record.sensitivity, units of the file for one "
            f"{measurement.unit or si}."
        )
    notes = []
    sensitive = sensitivity_given or unknown
    electric = unit is None or unit.si not in {q.unit for q in QUANTITIES.values()}
    if unit is not None and unit.si == si:
        if measurement.unit is None:
            measurement = replace(measurement, unit=stated)
        elif unit_of(measurement.unit) != unit and not sensitive:
            notes.append(
                f"{name}: states '{stated}'; record.unit = '{measurement.unit}' replaces it."
            )
    elif stated and measurement.unit is None and not (sensitive and electric):
        what = "no unit that is known" if unit is None else f"not a unit of {quantity}"
        raise RecordError(
            f"{name}: {contents.describe(series)} is in '{stated}', which is {what}. Give "
            f"record.sensitivity, {stated} for one {si}, or record.unit, one of {_EXAMPLES[si]}. "
            "Of an unknown sensitivity, write record.sensitivity_uncertainty = inf."
        )
    if unit is not None:
        words = unit.symbol
    else:
        words = stated or f"{measurement.unit or si}, which the file does not state"
    if unknown:
        words += ", of an unknown sensitivity"
    elif sensitive:
        words += f", {measurement.sensitivity:g} for one {measurement.unit or si}"
    return measurement, words, notes


def _stated_unit(series: Series, contents: FileContents) -> str:
    """Return the unit that a file states for a series, "" if it states none."""
    stated = agreed_unit(series, NAMES, contents).strip(" ()[]")
    plain = plain_name(series.name)
    if stated or plain in NAMES:
        return stated
    # What follows a known name, such as force_lb, may be a unit.
    ends = [plain[len(n) + 1 :] for n in NAMES if plain.startswith(f"{n}_")]
    return min((end for end in ends if not end.isdigit()), key=len, default="")


def si_factor(quantity: str, measurement: Measurement) -> float:
    """Return the SI value of one unit of the file. Raises RecordError for an unknown unit."""
    si = QUANTITIES[quantity].unit
    unit = unit_of(measurement.unit or si)
    if measurement.sensitivity_uncertainty == math.inf and (unit is None or unit.si != si):
        return 1.0 / measurement.sensitivity  # the gain has this unit
    if unit is None or unit.si != si:
        raise RecordError(
            f"record.unit = '{measurement.unit}': not a unit of {quantity}. Give one of "
            f"{_EXAMPLES[si]}."
        )
    return unit.size / measurement.sensitivity


def agreed_unit(series: Series, names: Collection[str], contents: FileContents) -> str:
    """Return the unit in the name of a series or beside it, "" without any.

    Args:
        series: of the file.
        names: plain names that a unit may follow after an underscore.
        contents: of the file.

    Raises:
        RecordError: name and file state different units.
    """
    own = name_and_unit(series.name, names)[1]
    if unit_of(own) and unit_of(series.unit) and unit_of(own) != unit_of(series.unit):
        raise RecordError(
            f"{contents.name}: {contents.describe(series)} has two units, '{own}' and "
            f"'{series.unit}'. Correct one of them in the file."
        )
    return own if unit_of(own) or not series.unit else series.unit
