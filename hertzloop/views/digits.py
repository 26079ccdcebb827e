"""Numbers as text: with the digits that their error leaves, and with their unit."""

import math
from collections.abc import Iterable

from hertzloop.common.readable import PREFIXES
from hertzloop.results.metric_rows import MetricRow, UncertainValue

UNKNOWN = "unknown"  # in the place of a number without a predictable digit

LEGEND = f"{UNKNOWN}: not predictable"

RANGE = "Ranges: contact may begin at any part of a step"

_SCALED = ("s", "J", "m", "N", "Pa")  # units that take prefixes
_PLAIN = 7  # digits before the decimal point that are written without an exponent


def known_digits(value: float, form: str, error: float = 0.0) -> str:
    """Write a number with the digits that its error leaves.

    Args:
        value: The number.
        form: Format specification of a number without error.
        error: Largest absolute error; 0 where all digits are predictable.

    Returns:
        The number as `form` has it or with fewer digits, "about 100" where digits before the
        decimal point are not predictable, `UNKNOWN` where none is.
    """
    # `z`: what is rounded to zero has no sign.
    usual = f"{value:+z{form[1:]}}" if form.startswith("+") else f"{value:z{form}}"
    if error == 0.0:
        return usual
    if not error < abs(value):  # as `_predictable` of results.verdict has it
        return UNKNOWN
    whole = math.floor(math.log10(abs(value)))
    digits = max(whole - math.floor(math.log10(error)), 1)
    # `#` keeps the zeros that are known.
    sign = "+" if form.startswith("+") else ""
    known = f"{value:{sign}#.{digits}g}".replace(".e", "e").removesuffix(".")
    shown = min(known, usual, key=lambda text: sum(c.isdigit() for c in text.partition("e")[0]))
    rounds = whole >= digits or "e+" in known
    return about(value, digits, sign) if shown is known and rounds else shown


def about(value: float, digits: int = 2, sign: str = "") -> str:
    """Return a rounded number in words, for example "about 300".

    Args:
        value: The number.
        digits: Number of significant digits.
        sign: "+" to write the sign of a positive number.
    """
    rounded = float(f"{value:.{digits}g}")
    plain = abs(rounded) < 10.0**_PLAIN
    return f"about {rounded:{sign},.0f}" if plain else f"about {rounded:{sign}.{digits}g}"


def shown_unit(unit: str, values: Iterable[float]) -> tuple[float, str]:
    """Return the factor and the unit in which the largest value has one to three digits before
    the decimal point."""
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if unit not in _SCALED or largest == 0.0:
        return 1.0, unit
    power = 3 * math.floor(math.log10(largest * (1.0 + 1e-3)) / 3.0)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return 10.0**-power, f"{PREFIXES[power]}{unit}"


def uncertain_text(
    found: UncertainValue, form: str, factor: float = 1.0, largest: float = 0.0
) -> str:
    """Write a number with the digits that its error leaves, or as a range.

    Args:
        found: The number, its error and its range.
        form: Format specification of a number without error.
        factor: Factor from the number to the unit that is printed.
        largest: Largest of the numbers beside it, in that unit: what is smaller than its last digit
            is zero.

    Returns:
        The range where it is wider than the error and than the last digit, else the number.
    """
    value, error = found.value * factor, found.error * factor
    low, high = sorted((found.least * factor, found.most * factor))
    width = high - low
    decimals = _decimals(form, max(abs(low), abs(high), largest))
    if width > max(error, 0.5 * 10.0**-decimals):
        sign = "+" if form.startswith("+") else ""
        for each in (width / 100.0, error / 2.0):  # an end may be wrong by two of its last digit
            if each > 0.0:
                decimals = min(decimals, -math.floor(math.log10(each)) - 1)
        shown = [round(end, decimals) for end in (low, high)]
        ends = [f"{end:{sign}z,.{max(decimals, 0)}f}" for end in shown]
        if ends[0] != ends[1]:
            return " to ".join(ends)
    if abs(value) <= error < math.inf and (value == 0.0 or error <= 0.5 * 10.0**-decimals):
        return f"{0.0:{form}}"
    return known_digits(value, form, error)


def _decimals(form: str, largest: float) -> int:
    """Return the decimals that a format gives a number."""
    digits = int(form.strip("+").strip(".fgz"))
    if form.endswith("f"):
        return digits
    return digits - 1 - (math.floor(math.log10(largest)) if largest else 0)


def value_texts(row: MetricRow, without: str = "-") -> list[str]:
    """Return the value of a metric, and that of the run that it is compared with, with units.

    Args:
        row: The metric.
        without: Text in the place of what is not defined.
    """
    values = [row.value, *([row.reference] if row.reference else [])]
    factor, unit = shown_unit(row.field.unit, (each.value for each in values))
    form = ".0f" if row.metric == "contacts" else ".4g"
    largest = max((abs(each.value) * factor for each in values), default=0.0)
    texts = [
        without
        if math.isnan(each.value)
        else with_unit(uncertain_text(each, form, factor, largest), unit)
        for each in values
    ]
    if row.from_zero and texts[-1] == UNKNOWN:
        texts[-1] = "nearly 0"
    return texts


def change_text(row: MetricRow, decimals: int = 1) -> str:
    """Return the change of a metric with its unit; empty if it is not defined.

    Args:
        row: The metric.
        decimals: Decimals of a change in dB; one in per cent has one fewer.
    """
    if row.from_zero:
        return "from 0"
    if row.change is None:
        return ""
    if row.field.difference:
        form = "+.0f" if row.metric == "contacts" else "+.2g"
        largest = max(abs(row.value.value), abs(row.reference.value if row.reference else 0.0))
        return with_unit(uncertain_text(row.change, form, 1.0, largest), row.unit)
    form = f"+.{decimals if row.unit == 'dB' else decimals - 1}f"
    return with_unit(uncertain_text(row.change, form), row.unit)


def has_range(rows: Iterable[MetricRow]) -> bool:
    """Return whether any text of some rows is a range."""
    return any(" to " in text for row in rows for text in (*value_texts(row), change_text(row)))


def with_unit(number: str, unit: str) -> str:
    """Return a number with its unit; a number that is unknown, and a count, have none."""
    return number if number == UNKNOWN or not unit else f"{number} {unit}"
