"""Numbers as people write them: `139 mJ`, not `1.39e+05 uJ`; `1e9`, not `1e+09`."""

import math
import re

# Prefixes of units, by power of ten.
PREFIXES = {-9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# Units that take a prefix; others, such as dB, % and kg, keep theirs.
_SCALED = ("J", "m", "N", "s", "Pa", "Hz", "m/s", "W")
_EXPONENT = re.compile(r"e([+-])0*(\d+)$")


def number(value: float, digits: int = 6) -> str:
    """Return a number in at most so many digits, with a short exponent if it needs one."""
    return _EXPONENT.sub(lambda found: f"e{found[1].strip('+')}{found[2]}", f"{value:.{digits}g}")


def argument(path: object) -> str:
    """Return a path as an argument of a command: one that begins with a dash is no option."""
    text = str(path)
    return f"./{text}" if text.startswith("-") else text


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """Return a value with the unit that people would choose for it.

    Args:
        value: The value, in `unit`.
        unit: SI unit without a prefix; text after a space, as in "m rms", is kept.
        digits: Significant digits, at least 3.
    """
    base, *more = unit.split(" ", 1)
    if base not in _SCALED or not math.isfinite(value) or value == 0.0:
        return f"{number(value, digits)} {unit}".rstrip()
    # The exponent of the rounded value, so that 999.9996 mJ is 1 J.
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    power = min(max(3 * (exponent // 3), min(PREFIXES)), max(PREFIXES))
    scaled = number(value / 10.0**power, digits)
    return " ".join([scaled, f"{PREFIXES[power]}{base}", *more])


def percent(share: float) -> str:
    """Return a share with the two digits that an estimate has."""
    return f"{100.0 * share:{'.0f' if 0.995 <= share < 10.0 else '.2g'}} %"
