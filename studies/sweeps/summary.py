"""What the rows of a sweep come to."""

from collections import Counter
from typing import Any

from studies.sweeps.evaluate import Rows

SHOWN = ("plate_energy_db", "rebound_percent", "radiated_db", "plate_speed_db", "pressure_db")


def counted(rows: Rows, column: str) -> dict[str, int]:
    """How many cases have each of the names in a column of `CaseFigures`."""
    names = (name for row in rows for name in (row[column] or "").split(", ") if name)
    return dict(Counter(names).most_common())


def known(rows: Rows, figure: str) -> Rows:
    """The cases that have a figure."""
    return [row for row in rows if row[figure] is not None and row[figure] == row[figure]]


def extremes(rows: Rows, keys: list[str]) -> list[list[str]]:
    """Where each figure is least and largest: its name, the least, its keys, the largest, its
    keys, in words."""
    found = []
    for figure in SHOWN:
        having = known(rows, figure)
        if not having:
            continue
        ends = [pick(having, key=lambda row: row[figure]) for pick in (min, max)]
        where = [
            ", ".join(f"{key.split('.')[-1]} {short(row[key])}" for key in keys) for row in ends
        ]
        least, most = (f"{row[figure]:.2f}" for row in ends)
        found.append([figure, least, where[0], most, where[1]])
    return found


def short(value: Any) -> str:
    """A value of a key in four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
