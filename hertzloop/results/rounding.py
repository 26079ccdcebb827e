"""Shares, pressures and times as text, rounded to the digits that an estimate has."""


def percent(share: float) -> str:
    """A share with the two digits that an estimate has."""
    return f"{100.0 * share:{'.0f' if 0.995 <= share < 10.0 else '.2g'}} %"


def pressure(pascal: float) -> str:
    """A pressure in words."""
    return f"{pascal * 1e-9:.3g} GPa" if pascal >= 1e8 else f"{pascal * 1e-6:.3g} MPa"


def time_words(us: float) -> str:
    """A time to two digits."""
    for unit, length in (("s", 1e6), ("ms", 1e3)):
        if us >= length:
            return f"{float(f'{us / length:.2g}'):g} {unit}"
    return f"{float(f'{us:.2g}'):g} us"
