"""Read the numbers of a table, a part of the text at a time."""

import math
import re
from contextlib import suppress

import numpy as np

from hertzloop.identification.records.errors import TableError, shorten
from hertzloop.identification.records.text.cells import (
    NUMBER,
    OVERFLOW,
    PLAIN_SIGNS,
    cell_kind,
    is_comment,
    split_cells,
)
from hertzloop.identification.records.text.dates import DateColumn
from hertzloop.identification.records.text.layout import TableLayout

_CHUNK = 1 << 17  # characters that are read at once
_FILLED, _EMPTY = re.compile(r'[^ \t\n;,|"]'), re.compile(r'\n[ \t;,|"]*\n')


class RowReader:
    """Reads the rows of a table, a part of the text at a time.

    Args:
        text: the whole text.
        head: its first lines, at least those above the table.
        layout: where the table is.
        notes: where sentences on what is not used are added.
    """

    def __init__(self, text: str, head: list[str], layout: TableLayout, notes: list[str]) -> None:
        self.text, self.layout, self.notes = text, layout, notes
        # Places in the text: of the next part, and of the first row.
        self._at = self._begin = sum(len(line) + 1 for line in head[: layout.start])
        self._line = layout.start
        # By column: a number with a comma, and one with a point.
        self._commas: dict[int, str] = {}
        self._points: dict[int, str] = {}
        self._texts: dict[int, tuple[int, str]] = {}  # by column: their number, and one of them
        self._below: list[tuple[int, str]] = []  # lines below the table, with their numbers
        self._comments = 0  # lines of comments in the table
        self._dates = {place: DateColumn() for place in layout.places}

    def read(self) -> list[np.ndarray]:
        """Return the columns, shape (rows,) each. Raises TableError."""
        text, layout = self.text, self.layout
        points = text.find(".", self._at) >= 0
        commas = layout.separator != "," and text.find(",", self._at) >= 0
        found = np.empty((len(layout.places), text.count("\n", self._at) + 1))
        rows = 0
        while self._at < len(text):
            end = text.find("\n", self._at + _CHUNK)
            end = len(text) if end < 0 else end
            chunk = text[self._at : end]
            if commas and not points:
                chunk = chunk.replace(",", ".")
            block = self._read_lines(chunk.split("\n"), bool(layout.dates) or (commas and points))
            found[:, rows : rows + block.shape[1]] = block
            rows += block.shape[1]
            self._at = end + 1
        self._add_notes(rows)
        return [column[:rows] for column in found]

    @property
    def interrupted(self) -> bool:
        """Whether empty lines, or lines of separators alone, stand between rows."""
        end = self.text.find(self._below[0][1], self._begin) if self._below else len(self.text)
        while end > self._begin and self.text[end - 1] in ' \t\n;,|"':
            end -= 1
        start = _FILLED.search(self.text, self._begin, end)
        return start is not None and _EMPTY.search(self.text, start.start(), end) is not None

    def _read_lines(self, lines: list[str], mixed: bool) -> np.ndarray:
        """Return the columns of some lines, (columns, rows); only unusual lines cell by cell."""
        found = None
        if not self._below and (self.layout.separator is not None or not self.layout.texts):
            found = self._read_plain(lines, mixed)
        if found is None and len(lines) > 64:
            half = len(lines) // 2
            parts = [self._read_lines(lines[:half], mixed), self._read_lines(lines[half:], mixed)]
            return np.concatenate(parts, axis=1)
        if found is None:
            found = self._read_cells(lines)
        self._line += len(lines)
        return found

    def _read_plain(self, lines: list[str], mixed: bool) -> np.ndarray | None:
        """Return the columns of lines without anything unusual, (columns, rows); None of others."""
        separator, places = self.layout.separator, self.layout.places
        lines = [line.replace('"', "") for line in lines if line and not line.isspace()]
        if not lines:
            return np.empty((len(places), 0))
        if separator is not None and (
            sum(line.count(separator) for line in lines) != len(lines) * (self.layout.cells - 1)
        ):
            return None
        if mixed:
            cells = [line.split(separator) for line in lines]
            if any(len(row) != self.layout.cells for row in cells) or any(
                "_" in line for line in lines
            ):
                return None
            with suppress(ValueError):
                return np.array([self._column([row[j] for row in cells], j) for j in places])
            return None
        for repaired in (False, True):
            if repaired and separator is not None:
                lines = [_fill_gaps(line, separator) for line in lines]
            with suppress(ValueError):
                found = np.loadtxt(
                    lines,
                    delimiter=separator,
                    comments=None,
                    ndmin=2,
                    usecols=None if separator is None else places,
                )
                return found.T if found.shape[1] == len(places) else None
        return None

    def _column(self, cells: list[str], place: int) -> list[float]:
        """Return values of cells with dates, or with commas beside other columns with points."""
        if place in self.layout.dates:
            return [self._dates[place].seconds(cell.strip()) for cell in cells]
        for sign, seen in ((",", self._commas), (".", self._points)):
            example = next((cell for cell in cells if sign in cell), None)
            if example is not None:
                seen.setdefault(place, example.strip())
        if place in self._commas:
            cells = [cell.replace(",", ".") for cell in cells]
        return [float(cell) for cell in cells]

    def _read_cells(self, lines: list[str]) -> np.ndarray:
        """Return the columns of some lines, read cell by cell, (columns, rows)."""
        layout = self.layout
        found: list[list[float]] = []
        for i, raw in enumerate(lines, self._line + 1):
            line = raw.translate(PLAIN_SIGNS)
            if not line.strip():
                continue
            if is_comment(line):
                self._comments += 1
                continue
            cells = split_cells(line, layout.separator)
            while len(cells) > layout.cells and not cells[-1]:
                cells.pop()
            if not any(cells):
                continue
            kinds = [cell_kind(cells[j], True) if j < len(cells) else "g" for j in layout.places]
            if not any(kind in "nd" for kind in kinds) and (
                "t" in kinds
                or all(j >= len(cells) or not cells[j] for j in layout.places)
                or (layout.separator is None and len(cells) != layout.cells)
            ):
                self._below.append((i, line))
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
                    f"line {i} has {len(cells)} cells and other lines have {layout.cells}. "
                    "Write the file again; it may be cut off, or numbers may have decimal commas "
                    "between columns separated by commas"
                )
            found.append(
                [
                    self._number(cells[j], kind, j, i) if j < len(cells) else math.nan
                    for j, kind in zip(layout.places, kinds, strict=True)
                ]
            )
        return np.array(found).T if found else np.empty((len(layout.places), 0))

    def _number(self, cell: str, kind: str, place: int, line: int) -> float:
        """Return the value of a cell; nan of a gap. Raises TableError for an unknown form."""
        if (kind == "d") != (place in self.layout.dates) and kind != "g":
            kind = "n" if NUMBER.fullmatch(cell) and place not in self.layout.dates else "t"
        if kind == "n":
            if "," in cell:
                self._commas.setdefault(place, cell)
                cell = cell.replace(",", ".")
            elif "." in cell:
                self._points.setdefault(place, cell)
            return float(cell.replace("D", "e").replace("d", "e"))
        if kind == "d":
            return self._dates[place].seconds(cell)
        if kind == "t":
            if any(c.isdigit() for c in cell):
                raise TableError(
                    f"line {line}: '{shorten(cell)}' in column {place + 1} is not a number that "
                    "can be read in one way. Write numbers without units, and without signs "
                    "between thousands"
                )
            number, example = self._texts.get(place, (0, cell))
            self._texts[place] = number + 1, example
        return math.nan

    def _add_notes(self, rows: int) -> None:
        """Add notes on what is not used. Raises TableError for two decimal signs in a column."""
        for place in self._commas.keys() & self._points.keys():
            raise TableError(
                f"column {place + 1} has numbers with commas and with points, such as "
                f"'{self._commas[place]}' and '{self._points[place]}'. Write one decimal sign"
            )
        for place, (number, example) in self._texts.items():
            self.notes.append(
                f"column {place + 1} has {number} texts in place of numbers, such as '{example}'."
            )
        if len(self._below) > max(20, rows):
            line, words = self._below[0]
            raise TableError(
                f"line {line} '{shorten(words)}' begins {len(self._below)} lines that do not "
                "belong to the table above. Give a file with one table"
            )
        if self._below:
            self.notes.append(
                f"not used below the table: {len(self._below)} lines from "
                f"'{shorten(self._below[0][1])}' on."
            )
        if self._comments:
            self.notes.append(f"comment lines in the table are not used: {self._comments}.")


def _fill_gaps(line: str, separator: str) -> str:
    """A line with "nan" in empty cells and in place of infinity as Microsoft writes it."""
    if "#" in line:
        line = OVERFLOW.sub("nan", line)
    if 2 * separator in line or line[0] == separator or line[-1] == separator:
        return separator.join(cell if cell.strip() else "nan" for cell in line.split(separator))
    return line
