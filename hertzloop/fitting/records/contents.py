"""What a file of a record holds: series with names, units and times."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from hertzloop.fitting.records.quantities import NAMES
from hertzloop.fitting.records.spacing import StatedSpacing
from hertzloop.fitting.records.units import name_and_unit


class Series(NamedTuple):
    """One series of a file.

    Attributes:
        name: of the column or channel.
        unit: stated in the name or beside it; "" if none is.
        values: as in the file, integers too, (samples,); they mean (values - zero)/levels.
        number: among the columns, arrays or channels of the file, from 1 on; unused ones count.
        group: of the file, to which the series belongs; "" without groups.
        time_s: times of its own, s, (samples,); None if other series hold them.
        is_time: whether it holds the times of others.
        zero: value that means zero.
        levels: counts of the file that make one unit.
    """

    name: str
    unit: str
    values: np.ndarray
    number: int
    group: str = ""
    time_s: np.ndarray | None = None
    is_time: bool = False
    zero: float = 0.0
    levels: float = 1.0


@dataclass
class FileContents:
    """What a file of records holds.

    Attributes:
        series: in the order of the file.
        tables: its `[record]` tables, at least one.
        spacing: time between samples; None if nothing states it.
        notes: sentences on what is not used.
        above: number of lines above a text table.
        kind: what the file calls a series.
        facts: keys of every `[record]` table that its format states.
        multiplier: factor of its values that the file states, as text.
        interrupted: whether empty lines stand between its rows.
        counted: number of its arrays or channels up to here, unused ones too.
        name: of the file, for messages.
    """

    series: list[Series]
    tables: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    spacing: StatedSpacing | None = None
    notes: list[str] = field(default_factory=list)
    above: int = 0
    kind: str = "column"
    facts: dict[str, Any] = field(default_factory=dict)
    multiplier: str = ""
    interrupted: bool = False
    counted: int = 0
    name: str = ""

    def describe(self, *series: Series) -> str:
        """Return series in words, such as "column 2 'Force [N]', column 4"."""
        several = len({one.group for one in self.series}) > 1
        return ", ".join(
            f"{self.kind} {one.number}"
            + (f" '{one.name}'" if one.name else "")
            + (f" of group '{one.group}'" if several and one.group else "")
            for one in series
        )


def is_series(series: Series, said: str | int) -> bool:
    """Whether a number or a name of the `[record]` table means a series."""
    if isinstance(said, int):
        return series.number == said
    stem, unit = name_and_unit(series.name, NAMES)
    stated = unit or series.unit.strip(" ()[]")
    return said in (series.name, stem, f"{stem} ({stated})", stated)
