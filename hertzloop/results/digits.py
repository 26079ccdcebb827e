"""Numbers as text, with the digits that are predictable: for tables, sentences and pages."""

import math

from hertzloop.results.spans import decibels

UNKNOWN = "unknown"  # in the place of a number without a predictable digit
LEGEND = f"{UNKNOWN}: not predictable"
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
    usual = f"{value:{form}}"
    if error == 0.0:
        return usual
    if not error < abs(value):
        return UNKNOWN
    whole = math.floor(math.log10(abs(value)))
    digits = max(whole - math.floor(math.log10(error)), 1)
    # `#` keeps the zeros that are known.
    sign = "+" if form.startswith("+") else ""
    known = f"{value:{sign}#.{digits}g}".replace(".e", "e").removesuffix(".")
    shown = min(known, usual, key=lambda text: sum(c.isdigit() for c in text.partition("e")[0]))
    return about(value, digits, sign) if shown is known and whole >= digits else shown


def about(value: float, digits: int = 2, sign: str = "") -> str:
    """A rounded number in words, e.g. "about 300"; 0 digits before the point are no news."""
    rounded = float(f"{value:.{digits}g}")
    plain = abs(rounded) < 10.0**_PLAIN
    return f"about {rounded:{sign},.0f}" if plain else f"about {rounded:{sign}.{digits}g}"


def change_db(
    value: float,
    reference: float,
    factor: float = 10.0,
    error: float = 0.0,
    reference_error: float = 0.0,
) -> tuple[float, float]:
    """A ratio in dB, nan where there is none, and its error by those of both numbers."""
    change = decibels(value, reference, factor)
    if math.isnan(change):
        return math.nan, math.nan
    wrong = error / abs(value) + reference_error / abs(reference)
    return change, factor / math.log(10.0) * wrong
