"""Names and units of the columns of a table."""

import re

from hertzloop.fitting.records.errors import TableError
from hertzloop.fitting.records.quantities import NAMES
from hertzloop.fitting.records.text.cells import (
    GAPS,
    NUMBER,
    cell_kind,
    is_comment,
    line_kinds,
    split_cells,
)
from hertzloop.fitting.records.text.column_names import SAMPLE_NUMBERS, is_time
from hertzloop.fitting.records.text.fact_names import (
    INTERVAL_FACTS,
    TIME_UNIT_FACTS,
    VALUE_UNIT_FACTS,
    is_one_of,
)
from hertzloop.fitting.records.text.layout import TableLayout
from hertzloop.fitting.records.text.table import TextTable
from hertzloop.fitting.records.units import UNITS_AT_ENDS, name_and_unit, plain_name, unit_of

_ROWS_ABOVE = 4  # lines of names, units and remarks
_FACTOR = re.compile(r"[x*\u00d7] ?[\d.]+(e[+-]?\d+|\^[+-]?\d+)?")  # of all values, such as x1e-3
_SIGNS = re.compile("[:=]")  # of a fact and its value


def read_headings(
    lines: list[str], layout: TableLayout, table: TextTable
) -> tuple[list[str], list[str]]:
    """Return names and units of all columns, "" without any, from the lines just above the table.

    Facts in these lines and notes on columns of text are added to the table.

    Args:
        lines: of the text.
        layout: where the table is.
        table: what was read so far.

    Raises:
        TableError: the heading has too few names.
    """
    above = _LinesAbove(lines, layout)
    heading, unit_row = above.heading_and_units()
    ends = (place + 1 for place in (*layout.places, *layout.texts))
    count = max(len(heading), len(unit_row), *ends)
    heading, unit_row = (row + [""] * (count - len(row)) for row in (heading, unit_row))
    for name, unit in list(zip(heading, unit_row, strict=True))[layout.width :]:
        if name and unit:
            table.facts.setdefault(plain_name(name), []).append(unit)
    for row in above.rows:
        if any(_FACTOR.fullmatch(cell) for cell in row):
            table.facts.setdefault("multiplier", [", ".join(row)])
    unused = _units_in_columns(lines, layout, unit_row)
    texts = [heading[place] or str(place + 1) for place in unused]
    if texts:
        table.notes.append(f"text is not used: column {', '.join(texts)}.")
    return heading, unit_row


def _units_in_columns(lines: list[str], layout: TableLayout, unit_row: list[str]) -> list[int]:
    """Add units that stand in a column of their own, as of "Force" and "Unit", to the row of units.
    Return the columns of text that are not used."""
    unused = list(layout.texts)
    for place in layout.texts:
        inside = {
            cells[place]
            for line in lines[layout.start : layout.last + 1]
            if len(cells := split_cells(line, layout.separator)) > place
        }
        if place - 1 in layout.places and len(inside) == 1 and unit_of(one := inside.pop()):
            unit_row[place - 1] = unit_row[place - 1] or one
            unused.remove(place)
    return unused


class _LinesAbove:
    """The lines just above a table, which may hold the names and the units of its columns.

    Attributes:
        near: the last lines above the table that are not empty.
        rows: cells of those that are as long as rows of the table.
    """

    def __init__(self, lines: list[str], layout: TableLayout) -> None:
        self.layout = layout
        near = [x for x in lines[: layout.start] if set(line_kinds(x, layout.separator)) - {"g"}]
        self.near = near[-_ROWS_ABOVE:]
        spaces = layout.separator is None
        lengths = {layout.cells} | {
            len(self.cells(x))
            for x in self.near
            if any(is_one_of(plain_name(c), INTERVAL_FACTS) for c in self.cells(x))
        }
        self.rows = [
            cells
            for line in self.near
            if len(cells := self.cells(line)) >= layout.width
            and not (spaces and (len(cells) not in lengths or "\t" in line.strip()))
            and (not is_comment(line) or self.known_names(cells))
        ]

    def heading_and_units(self) -> tuple[list[str], list[str]]:
        """Return the row of names and the row of units; an empty one where there is none."""
        rows, places = self.rows, self.layout.places
        unit_row = next((row for row in reversed(rows) if self.known_units(row)), [])
        named = [
            row
            for row in rows
            if row is not unit_row
            and self.known_names(row)
            and not all(is_time(row[j]) for j in places)
        ]
        heading = max(reversed(named), key=self.known_names, default=[])
        if heading and not unit_row and heading is not rows[-1]:
            below = rows[[row is heading for row in rows].index(True) + 1]
            if not any(NUMBER.fullmatch(below[j]) for j in places):
                unit_row = below  # of units that nobody knows
        if not heading and rows:
            heading = self._unknown_heading(unit_row)
        if not heading and self.near and not unit_row:
            self._refuse_short_heading()
        return heading or unit_row, unit_row

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line above the table."""
        layout = self.layout
        line = line.strip().lstrip("#%/ ") if is_comment(line) else line
        if layout.separator is None and layout.cells == 1:
            return [line.strip().strip('"')]
        cells = split_cells(line, layout.separator)
        if layout.separator is None:  # a unit in brackets belongs to the name before it
            words, cells = cells, []
            for word in words:
                if cells and word[0] in "([" and len(words) > layout.cells:
                    cells[-1] += f" {word}"
                else:
                    cells.append(word)
        while len(cells) > layout.width and not cells[-1]:
            cells.pop()
        return cells

    def known_names(self, cells: list[str]) -> int:
        """Return how many cells are names of columns; 0 of a fact and its value."""
        if any("d" in cell_kind(cell, True) for cell in cells) or "=" in cells[0]:
            return 0
        numbers = any(NUMBER.fullmatch(cell) for cell in cells)
        return sum(
            bool(cell)
            and (
                (is_time(cell) and unit_of(cell) is None)
                or _is_known_name(cell)
                or (not numbers and cell[0] not in "([{<" and bool(name_and_unit(cell, ())[1]))
            )
            for cell in cells
        )

    def known_units(self, cells: list[str]) -> int:
        """Return how many cells are units; 0 if others are more likely names or values."""
        found = [c for c in cells if c and not NUMBER.fullmatch(c)]
        bare = [
            c
            for c in found
            if c[0] not in "([{<" and (unit_of(c) or c.lower() not in SAMPLE_NUMBERS | GAPS)
        ]
        good = [c for c in found if unit_of(c) or c in UNITS_AT_ENDS or c.lower() == "sequence"]
        if any(NUMBER.fullmatch(cells[j]) for j in self.layout.places if j < len(cells)):
            return 0
        return len(good) if not self.known_names(cells) and len(good) >= len(bare) else 0

    def _unknown_heading(self, unit_row: list[str]) -> list[str]:
        """Return the last row as the names of columns if it can hold them; else an empty row."""
        rows = self.rows
        row = rows[-1] if rows[-1] is not unit_row else rows[-2] if len(rows) > 1 else []
        if not row:
            return []
        plain = [self.cells(line) for line in self.near]
        fact = is_one_of(plain_name(row[0]), (*TIME_UNIT_FACTS, *VALUE_UNIT_FACTS))
        numbers = any(cell_kind(cell, True) in "nd" for cell in row)
        whole = all(row[j] for j in self.layout.places[1:])
        if row in plain[-2:] and whole and not fact and not numbers and "=" not in row[0]:
            return row
        return []

    def _refuse_short_heading(self) -> None:
        """Raise TableError if the last line names fewer columns than the table has."""
        width, cells = self.layout.width, self.cells(self.near[-1])
        if len(cells) < width and self.known_names(cells) and not _SIGNS.search(self.near[-1]):
            raise TableError(
                f"the heading names {len(cells)} columns and the rows have {width}. Give a name "
                "for each column, and separate the columns by semicolons if numbers have decimal "
                "commas"
            )


def _is_known_name(cell: str) -> bool:
    """Whether a cell is the name of a quantity, with or without a unit or a number behind it."""
    name = plain_name(name_and_unit(cell, NAMES)[0])
    return name in NAMES or re.sub(r"_?\d+$", "", name) in NAMES
