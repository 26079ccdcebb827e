"""Numbers as text: with the digits that their error leaves, and with their unit."""

import math
from collections.abc import Iterable, Sequence

from hertzloop.results.metric_fields import MetricField
from hertzloop.results.span_metrics import change_db

UNKNOWN = "unknown"  # in the place of a number without a predictable digit

LEGEND = f"{UNKNOWN}: not predictable"

_FROM_NOTHING = 1e3  # ratio from which on a reference is nearly zero
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
    return about(value, digits, sign) if shown is known and whole >= digits else shown


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


def energy_unit(energies_j: Iterable[float]) -> tuple[float, str]:
    """Return the factor from J and the unit in which four digits of energies need no exponent."""
    large = max((abs(energy) for energy in energies_j), default=0.0) >= 1e-2
    return (1e3, "mJ") if large else (1e6, "uJ")


def cells(
    row: MetricField, values: Sequence[float], errors: Sequence[float], form: str, without: str
) -> list[str]:
    """Return a metric of several runs with its unit and its predictable digits.

    Args:
        row: Factor and unit of the metric.
        values: Its value in each run.
        errors: Largest absolute error in each run.
        form: Format specification of a number without error.
        without: Text in the place of nan.
    """
    factor, unit = row.factor, row.unit
    if unit == "uJ":
        factor, unit = energy_unit(value for value in values if not math.isnan(value))
    return [
        without
        if math.isnan(value)
        else with_unit(known_digits(value * factor, form, error * factor), unit)
        for value, error in zip(values, errors, strict=True)
    ]


def with_unit(number: str, unit: str) -> str:
    """Return a number with its unit; a number that is unknown has none."""
    return number if number == UNKNOWN else f"{number} {unit}"


def change_cell(
    db: float,
    values: Sequence[float],
    errors: Sequence[float],
    decimals: int,
    from_nothing: str = "",
) -> str:
    """Return the change from the second value to the first, with its predictable digits.

    Args:
        db: Factor of the logarithm for a change in dB; 0 for one in per cent.
        values: The two values.
        errors: Their largest absolute errors.
        decimals: Decimals of a change in dB; one in per cent has one fewer.
        from_nothing: Text for a value without control that lies within the model's error.

    Returns:
        The change with its unit; empty if the change has no meaning.
    """
    (value, reference), (error, reference_error) = values, errors
    if math.isnan(value) or math.isnan(reference) or reference == 0.0:
        return ""
    if db:
        change, wrong = change_db(value, reference, db, error, reference_error)
        known = known_digits(change, f"+.{decimals}f", wrong)
        return "" if math.isnan(change) else with_unit(known, "dB")
    if reference < 0.0 or value < 0.0:
        return ""
    if value > _FROM_NOTHING * reference:
        return from_nothing
    wrong = 100.0 * (error + reference_error * (value / reference)) / reference
    change = 100.0 * (value / reference - 1.0)
    return with_unit(known_digits(change, f"+.{decimals - 1}f", wrong), "%")
