"""Read the numbers of a table: parts of plain rows at once, parts with anything unusual by rows."""

import math
import re
from contextlib import suppress

import numpy as np

from hertzloop.common.decimal_signs import may_separate_thousands
from hertzloop.fitting.records.errors import TableError, shorten
from hertzloop.fitting.records.text.cells import (
    cell_kind,
    is_comment,
    split_cells,
)
from hertzloop.fitting.records.text.dates import DateColumn
from hertzloop.fitting.records.text.layout import TableLayout

_CHUNK = 1 << 15  # characters of a part
_BLANKS = ' \t\n;,|"'
_EMPTY_LINE = re.compile(r'\n[ \t;,|"]*\n')


class RowReader:
    """Reads the rows of a table.

    Args:
        text: the whole text.
        head: its first lines, at least those above the table.
        layout: where the table is.
        notes: where sentences on what is not used are added.
    """

    def __init__(self, text: str, head: list[str], layout: TableLayout, notes: list[str]) -> None:
        self.text, self.layout, self.notes = text, layout, notes
        self._begin = sum(len(line) + 1 for line in head[: layout.start])  # place of the first row
        self._line = layout.start  # number of lines that were read
        self._signed: dict[tuple[str, int], str] = {}  # by sign and column: a number with it
        self._decimal: set[tuple[str, int]] = set()  # those whose sign cannot separate thousands
        self._texts: dict[int, list[str]] = {place: [] for place in layout.places}
        self._below: list[tuple[int, str]] = []  # lines below the table, with their numbers
        self._comments = 0  # lines of comments in the table
        self._dates = {place: DateColumn() for place in layout.dates}

    def read(self) -> np.ndarray:
        """Return the columns, shape (columns, rows). Raises TableError."""
        at, blocks = self._begin, [np.empty((len(self.layout.places), 0))]
        while at < len(self.text):
            end = self.text.find("\n", at + _CHUNK)
            end = len(self.text) if end < 0 else end
            lines = self.text[at:end].split("\n")
            block = self._read_plain(lines)
            blocks.append(self._read_rows(lines) if block is None else block)
            self._line += len(lines)
            at = end + 1
        found = np.concatenate(blocks, axis=1)
        self._add_notes(found.shape[1])
        return found

    @property
    def interrupted(self) -> bool:
        """Whether empty lines, or lines of separators alone, stand between rows."""
        end = self.text.find(self._below[0][1], self._begin) if self._below else len(self.text)
        return _EMPTY_LINE.search(self.text[self._begin : end].strip(_BLANKS)) is not None

    def _read_plain(self, lines: list[str]) -> np.ndarray | None:
        """Return the columns of lines without anything unusual, (columns, rows); None of others."""
        layout = self.layout
        rows = [line.replace('"', "").split(layout.separator) for line in lines if line.strip()]
        if self._below or any(len(row) != layout.cells for row in rows):
            return None
        with suppress(ValueError):
            columns = [self._column([row[place] for row in rows], place) for place in layout.places]
            found = np.array(columns)
            return None if np.any(np.all(np.isnan(found), axis=0)) else found
        return None

    def _column(self, cells: list[str], place: int) -> np.ndarray:
        """Return the values of cells, nan of empty ones. Raises ValueError for other cells."""
        if place in self._dates:
            return np.array([self._dates[place].seconds(cell.strip()) for cell in cells])
        if any("_" in cell for cell in cells):
            raise ValueError("Python reads numbers with underscores, and nobody else does")
        found = np.array([cell.replace(",", ".") or "nan" for cell in cells], float)
        self._note_signs(cells, place)
        return found

    def _note_signs(self, cells: list[str], place: int) -> None:
        """Note the signs in numbers of a column."""
        for sign in ",.":
            signed = [cell.strip() for cell in cells if sign in cell]
            if signed and (sign, place) not in self._decimal:
                self._signed.setdefault((sign, place), signed[0])
                if not all(map(may_separate_thousands, signed)):
                    self._decimal.add((sign, place))

    def _read_rows(self, lines: list[str]) -> np.ndarray:
        """Return the columns of some lines, read row by row, (columns, rows)."""
        layout = self.layout
        found: list[list[float]] = []
        for number, line in enumerate(lines, self._line + 1):
            if is_comment(line):
                self._comments += 1
                continue
            cells = split_cells(line, layout.separator)
            while len(cells) > layout.cells and not cells[-1]:
                cells.pop()
            if not any(cells):
                continue
            if self._is_below(cells):
                self._below.append((number, line))
                continue
            if self._below:
                at, words = self._below[0]
                raise TableError(
                    f"line {at} '{shorten(words)}' stands between rows of numbers. Give a file "
                    "with one table"
                )
            short = layout.separator is None and len(cells) < layout.cells
            if len(cells) > layout.cells or short:
                raise TableError(
                    f"line {number} has {len(cells)} cells and other lines have {layout.cells}. "
                    "Write the file again; it may be cut off, or numbers may have decimal commas "
                    "between columns separated by commas"
                )
            cells += [""] * (layout.width - len(cells))
            found.append([self._value(cells[place], place, number) for place in layout.places])
        return np.array(found).reshape(-1, len(layout.places)).T

    def _is_below(self, cells: list[str]) -> bool:
        """Whether the cells of a line are no row of the table: texts stand for its numbers."""
        layout = self.layout
        inside = [cells[place] for place in layout.places if place < len(cells)]
        kinds = {cell_kind(cell, True) for cell in inside}
        return not kinds & {"n", "d"} and (
            "t" in kinds
            or not any(inside)
            or (layout.separator is None and len(cells) != layout.cells)
        )

    def _value(self, cell: str, place: int, line: int) -> float:
        """Return the value of a cell; nan of a gap. Raises TableError for an unknown form."""
        kind = cell_kind(cell, True)
        if kind == "d" and place in self._dates:
            return self._dates[place].seconds(cell)
        if kind == "n" and place not in self._dates:
            self._note_signs([cell], place)
            return float(cell.replace(",", ".").replace("D", "e").replace("d", "e"))
        if kind != "g":
            if any(c.isdigit() for c in cell):
                raise TableError(
                    f"line {line}: '{shorten(cell)}' in column {place + 1} is not a number that "
                    "can be read in one way. Write numbers without units, and without signs "
                    "between thousands"
                )
            self._texts[place].append(cell)
        return math.nan

    def _add_notes(self, rows: int) -> None:
        """Add notes on what is not used. Raises TableError for decimal signs that are unclear."""
        self._refuse_unclear_signs()
        for place, texts in self._texts.items():
            if texts:
                self.notes.append(
                    f"column {place + 1} has {len(texts)} texts in place of numbers, such as "
                    f"'{texts[0]}'."
                )
        if self._below:
            number, line = self._below[0]
            if len(self._below) > max(20, rows):
                raise TableError(
                    f"line {number} '{shorten(line)}' begins {len(self._below)} lines that do not "
                    "belong to the table above. Give a file with one table"
                )
            self.notes.append(
                f"not used below the table: {len(self._below)} lines from '{shorten(line)}' on."
            )
        if self._comments:
            self.notes.append(f"comment lines in the table are not used: {self._comments}.")

    def _refuse_unclear_signs(self) -> None:
        """Raise TableError for two decimal signs in a column, and for one that may separate
        thousands: a comma, unless another column has decimal commas only, and a point beside
        decimal commas."""
        decimal = {sign for sign, _ in self._decimal}
        for (sign, place), cell in self._signed.items():
            other = "." if sign == "," else ","
            if (other, place) in self._signed:
                raise TableError(
                    f"column {place + 1} has numbers with commas and with points, such as "
                    f"'{cell}' and '{self._signed[other, place]}'. Write one decimal sign"
                )
            unclear = other in decimal or (sign == "," and sign not in decimal)
            if (sign, place) not in self._decimal and unclear:
                raise TableError(
                    f"column {place + 1}: '{cell}' may be {cell.replace(',', '.')} or "
                    f"{cell.replace(sign, '')}, as the {'comma' if sign == ',' else 'point'} may "
                    "begin the decimals or separate thousands. Write one decimal sign in all "
                    "columns, and no sign between thousands"
                )
