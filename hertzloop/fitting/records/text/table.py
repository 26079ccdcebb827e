"""The types of a table in a text file."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


class TextColumn(NamedTuple):
    """A column: its heading, the unit in it or below it, its number in the file from 1 on, and its
    values, shape (rows,), nan where there is none; dates are in s."""

    heading: str
    unit: str
    number: int
    values: np.ndarray
    dates: bool


@dataclass
class TextTable:
    """A table: columns, facts beside it by plain name, texts of comment lines, what was not used,
    how many lines are above it, and whether empty lines stand between its rows."""

    columns: list[TextColumn]
    facts: dict[str, list[str]] = field(default_factory=dict)
    comments: str = ""
    notes: list[str] = field(default_factory=list)
    above: int = 0
    interrupted: bool = False
