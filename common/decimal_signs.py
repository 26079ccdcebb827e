"""Decimal signs that could also separate thousands."""

import re

_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")


def may_separate_thousands(number: str) -> bool:
    """Return whether the point or comma of a number may stand between thousands, as in 1,200."""
    return _GROUPED.fullmatch(number) is not None
