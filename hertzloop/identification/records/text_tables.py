"""Tables of numbers in text files: finds the table below any preamble, and says what it read.

Instruments and programs write lines of facts before the table, beside it and below it. The rows of
numbers decide where the table is: the last lines that look alike, and what fits them above.
"""

import codecs
import csv
import datetime
import functools
import math
import re
from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hertzloop.identification.records.units import (
    UNITS_AT_ENDS,
    StatedUnit,
    name_and_unit,
    plain_name,
    unit_of,
)


class TableError(ValueError):
    """A text file is no table, or could be read in two ways. The message says what to do."""

    exit_status = 2


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


_CHUNK = 1 << 17  # characters that are read at once
_ROWS_ABOVE = 4  # lines of names, units and remarks
_COMMENT = ("#", "%", "//")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+-]?\d+)?")
_OVERFLOW = re.compile(r"[+-]?1[.,]#\w+")  # as Microsoft's library writes infinity and nan
_GAPS = frozenset({
    "", "nan", "inf", "infinity", "n/a", "#n/a", "na", "null", "none", "-", "--", "---", "*", "**",
    "***", "****", "?", "ovl", "ovld", "ol", "over", "overflow", "overload", "overrange", "invalid",
    "nil", "missing", "#num!", "#value!", "#div/0!", "\u221e", "no data", "clipped", "<na>", "nat",
})  # fmt: skip
_FILLED, _EMPTY = re.compile(r'[^ \t\n;,|"]'), re.compile(r'\n[ \t;,|"]*\n')
_DATE = re.compile(
    r"(?:(\d{1,4})([-/.])(\d{1,2})\2(\d{1,4})(?:[T ,]+|$))?"
    r"(?:(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+|:\d{3,})*))?|(\d{1,2}):(\d\d[.,]\d+))?"
    r"\s*([AaPp][Mm])?\s*(Z|[+-]\d\d:?\d\d)?"
)
_DURATION = re.compile(rf"^({_NUMBER.pattern}) (sec|min|hr)(?=[,;\t])", re.MULTILINE)
SAMPLE_NUMBERS = frozenset({
    "", "sample", "samples", "sequence", "index", "n", "no", "nr", "number", "point", "points",
    "row", "i", "idx", "step", "sample_number", "sample_no", "unnamed_0",
})  # fmt: skip
TIMES = frozenset({
    "time", "t", "timestamp", "datetime", "date", "x", "x_axis", "xaxis", "x_value", "x_values",
    "elapsed", "elapsed_time", "relative_time", "absolute_time", "time_axis", "time_stamp",
    "date_time", "time_of_day",
})  # fmt: skip
_SAFE = str.maketrans({"\u2212": "-", "\u00a0": " ", "\u202f": " "})


def is_time(heading: str, unit: str = "") -> bool:
    """Whether a column holds times, by its heading and the unit beside it."""
    name, own = name_and_unit(heading, TIMES)
    stated = unit_of(own or unit)
    if stated is not None:
        return stated.si == "s" and plain_name(heading) != "xi_s"
    if unit and plain_name(unit) in SAMPLE_NUMBERS:
        return False
    plain = plain_name(name)
    return plain in TIMES or re.sub(r"_?\d+$", "", plain) in TIMES - {"x", "t"}


def read_table(path: Path, names: Collection[str] = ()) -> TextTable:
    """Read the table of a text file.

    Args:
        path: the file, in UTF-8, UTF-16 or an encoding of Windows.
        names: plain names that headings may have; they tell a heading from other lines.

    Raises:
        TableError: there is no table, or there are several.
        OSError: the file cannot be read.
    """
    return read_text(decoded(path.read_bytes()), names)


def read_text(text: str, names: Collection[str] = ()) -> TextTable:
    """Read the table of a text. Arguments and errors are those of `read_table`."""
    if "\r" in text:
        text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    inside = {unit for _, unit in _DURATION.findall(text[-2000:])}
    text = _DURATION.sub(r"\1", text) if len(inside) == 1 else text
    lines: list[str] = []
    layout = None
    for most in (300, 3000, 30_000):  # a long preamble needs more lines
        lines = [line.translate(_SAFE) for line in text.split("\n", most)[:most]]
        layout = _found(lines)
        if len(lines) < most or (layout is not None and _goes_on(layout, lines, text[-2000:])):
            break
    if layout is None:
        return TextTable([], comments=_comments(lines), above=sum(1 for x in lines if x.strip()))
    _one_table(lines, layout)
    table = TextTable([], above=sum(1 for line in lines[: layout.start] if line.strip()))
    table.comments = _comments(lines[: layout.start])
    headings, units = _headings(lines, layout, names, table)
    _facts(lines, layout, table)
    rows = _Rows(text, lines, layout, table.notes)
    values = rows.read()
    for place, found in zip(layout.places, values, strict=True):
        heading = headings[place] if place < len(headings) else ""
        unit = units[place] if place < len(units) else ""
        unit = inside.pop() if place == 0 and len(inside) == 1 else unit
        if not unit and len(heading) > 3 and unit_of(heading):  # such as "Second"
            unit = heading
        table.columns.append(TextColumn(heading, unit, place + 1, found, place in layout.dates))
    only = table.columns[0].values
    if len(table.columns) == 1 and not table.columns[0].heading and only[0] == len(only) - 1:
        raise TableError(f"its first number, {only[0]:g}, counts those below it. Remove it")
    table.interrupted = rows.interrupted
    return table


def decoded(raw: bytes) -> str:
    """The text of a file. Two-byte signs without a mark show in the places of their zeros."""
    start = raw[:4096]
    if start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        kind = "utf-16"
    elif start.count(0) > len(start) // 4:
        kind = "utf-16-le" if start[1::2].count(0) > start[::2].count(0) else "utf-16-be"
    else:
        kind = "utf-8-sig"
    if kind != "utf-8-sig" and len(raw) % 2:
        raw = raw[:-1]  # cut off within a sign
    try:
        text = raw.decode(kind)
    except UnicodeDecodeError:
        text = raw.decode("cp1252", "replace")
    if "\0" in text:
        raise TableError("holds binary data. Give a text file, or rename it by its format")
    return text


class _TableLayout(NamedTuple):
    """Where the table is: first line, separator (None for spaces), places of its columns, those
    with dates, cells of a row, places of columns of text, and the last
    line that was looked at."""

    start: int
    separator: str | None
    places: tuple[int, ...]
    dates: frozenset[int]
    cells: int
    texts: tuple[int, ...]
    last: int


def _goes_on(layout: _TableLayout, lines: list[str], end: str) -> bool:
    """Whether a table reaches from the first half of the lines to the end of the text."""
    tail = [_kinds(line, layout.separator) for line in end.split("\n")[1:] if line.strip()][-8:]
    return 2 * layout.start < len(lines) < layout.last + 20 and any(
        all(kinds[j : j + 1] in ("n", "d") for j in layout.places) for kinds in tail
    )


def _is_comment(line: str) -> bool:
    words = line.lstrip().lower()
    return words.startswith(_COMMENT) and not words.startswith(
        ("#n/a", "#num!", "#value!", "#div/")
    )


def _split(line: str, separator: str | None) -> list[str]:
    """Cells of a line, without quotes and spaces around them."""
    if '"' in line:
        found = next(csv.reader([line], delimiter=separator or " ", skipinitialspace=True), [])
        return [cell.strip() for cell in found]
    if separator is None:
        return line.split()
    return [cell.strip() for cell in line.split(separator)]


@functools.lru_cache(maxsize=1 << 14)
def _kind(cell: str, decimal_comma: bool) -> str:
    """What a cell is: "n" number, "d" date, "g" gap, "t" text."""
    if _NUMBER.fullmatch(cell):
        return "n" if decimal_comma or "," not in cell else "t"
    if cell.lower().lstrip("+-") in _GAPS or cell.lower() in _GAPS or _OVERFLOW.fullmatch(cell):
        return "g"
    return "d" if any(c in cell for c in ":-/.") and _moment(cell) is not None else "t"


def _kinds(line: str, separator: str | None) -> str:
    """The kinds of a line's cells; "" of an empty line, and of one with empty cells only."""
    cells = _split(line, separator)
    if not any(cells):
        return ""
    return "".join(_kind(cell, separator != "," or '"' in line) for cell in cells)


def _alike(kinds: list[str], i: int, least: int) -> bool:
    """Whether a line and those before it are rows of one table."""
    before = [k for k in kinds[max(0, i - 12) : i + 1] if k][-least:]
    texts = {tuple(_texts(k)) for k in before}
    numbers = [{j for j, c in enumerate(k) if c in "nd"} for k in before]
    return len(texts) == 1 and bool(set.intersection(*numbers))


def _found(lines: list[str]) -> _TableLayout | None:
    """The layout of the table, by the separator that makes the longest and cleanest one."""
    given = next((line for line in lines if line.strip()), "").strip().strip('"')
    forced = re.fullmatch(r"sep=(.)", given, re.IGNORECASE)
    tried = [forced[1]] if forced else ["\t", ";", "|", ",", None]
    runs = (_run(lines, separator, forced is not None) for separator in tried)
    found = [one for one in runs if one is not None]
    if not found:
        return None
    # A table ends the file, but for a few lines below it.
    latest = max(layout.last for _, _, layout in found)
    found = [one for one in found if one[2].last > latest - 4]
    most = max(rows for rows, _, _ in found)
    layout = max(found, key=lambda one: (one[0] >= 0.9 * most, one[1]))[2]  # the first of these
    if layout.separator == "," and not forced:
        single = _run(lines, None, False)
        if single is not None and _one_column(lines, layout):
            layout = single[2]
    return layout


def _one_column(lines: list[str], layout: _TableLayout) -> bool:
    """Whether commas that seem to separate whole numbers are decimal. Raises TableError if nothing
    tells one from the other."""
    rows = [line.strip() for line in lines[layout.start :] if line.strip()]
    if layout.cells > 2 or any("." in _OVERFLOW.sub("", x) or _kind(x, True) == "t" for x in rows):
        return False
    above = [x for x in lines[: layout.start] if x.strip() and not _is_comment(x)
             and _kind(x.strip(), True) == "t"]  # fmt: skip
    if not above:
        raise TableError(
            f"line {layout.start + 1} '{_short(rows[0])}' may hold two whole numbers or one with a "
            "decimal comma. Give a line with the names of the columns"
        )
    return "," not in above[-1]


def _one_table(lines: list[str], layout: _TableLayout) -> None:
    """Refuse rows of numbers above the line that begins the table."""
    above = [_kinds(line, layout.separator) for line in lines[: layout.start]]
    rows = [i for i, k in enumerate(above) if len(k) == layout.cells
            and all(k[j] in "nd" for j in layout.places)
            and all(c in "ndg" or j in layout.texts for j, c in enumerate(k))]  # fmt: skip
    between = [i for i in range(rows[-1] + 1, layout.start) if above[i]] if rows else []
    if len(rows) > 1 or len(between) == 1:
        at = (between or rows)[0]
        raise TableError(
            f"line {at + 1} '{_short(lines[at])}' stands between rows of numbers. Give a file with "
            "one table"
        )


def _run(
    lines: list[str], separator: str | None, forced: bool
) -> tuple[int, bool, _TableLayout] | None:  # fmt: skip
    """Rows of the table by one separator: how many, whether without columns of text, layout."""
    kinds = ["" if _is_comment(line) else _kinds(line, separator) for line in lines]
    back = [i for i in range(len(kinds) - 1, -1, -1) if kinds[i]]
    last = next((i for least in (3, 2, 1) for i in back if _alike(kinds, i, least)), None)
    if last is None or not (
        forced or separator is None or any(separator in lines[i] for i in back[:3])
    ):
        return None
    sure = {j for j, c in enumerate(kinds[last]) if c in "nd"}
    usual = set(_texts(kinds[last]))
    places, rows, start = set(sure), [], last
    for i in range(last, -1, -1):
        if set(kinds[i]) <= {"g"} or all(kinds[i][j : j + 1] == "g" for j in sure):
            continue
        here = {j for j, c in enumerate(kinds[i]) if c in "nd"}
        wrong = set(_texts(kinds[i]))
        if wrong & sure or not here & (sure | places):
            # A text in place of a number stays in the table if rows follow above it.
            above = [k for k in kinds[max(0, i - 12) : i] if k][-3:]
            fits = [k for k in above if all(k[j : j + 1] in ("n", "d", "g") for j in sure)
                    and set(_texts(k)) <= usual]  # fmt: skip
            if len(fits) < 2:
                break
            if here & sure:
                rows.append(i)
            continue
        places = (places | here) - (wrong - sure)
        rows.append(i)
        start = i
    # Facts whose values stand in the places of the numbers, and those in places of their own.
    top = list(takewhile(lambda i: _names_next(kinds[i], usual, sure), reversed(rows)))
    names = [plain_name(_split(lines[i], separator)[kinds[i].index("t")]) for i in top]
    if 0 < len(top) < len(rows) and (len(set(names)) > 1 or _means(names[0], _SAID)):
        rows = rows[: -len(top)]
        start = rows[-1]
    places = {j for j in places if j in sure or any(
        kinds[i][j : j + 1] in ("n", "d") and not set(_texts(kinds[i][:j])) - usual for i in rows
    )}  # fmt: skip
    counts = Counter(j for i in rows for j, c in enumerate(kinds[i]) if c in "nd")
    texts = {j for i in rows for j in _texts(kinds[i])} - sure
    kept = tuple(sorted(j for j in places - texts if counts[j]))
    dates = frozenset(
        j for j in kept
        if 2 * sum(1 for i in rows if j < len(kinds[i]) and kinds[i][j] == "d") > counts[j]
    )  # fmt: skip
    lengths = sorted(len(kinds[i]) for i in rows)
    cells = lengths[len(lengths) // 2]
    if not kept:
        return None
    many = {j for j in texts if 2 * sum(kinds[i][j : j + 1] == "t" for i in rows) > len(rows)}
    # Names of facts stand on the left and differ from line to line. A text with another separator
    # in it is several cells.
    for j in many:
        texts_there = [_split(lines[i], separator)[j] for i in rows if j < len(kinds[i])]
        if re.search(r"[;|\t]" if separator else r"[;|\t]|,[-+]?[\d.]", texts_there[0]):
            return None
        if j < kept[0] and len(set(texts_there)) > 0.5 * len(texts_there) + 1:
            return None
    layout = _TableLayout(start, separator, kept, dates, cells, tuple(sorted(texts)), last)
    return len(rows), not many, layout


def _texts(kinds: str) -> list[int]:
    """Places of texts."""
    return [j for j, c in enumerate(kinds) if c == "t"]


def _names_next(kinds: str, usual: set[int], sure: set[int]) -> bool:
    """Whether the first text of a row stands where rows have none, just left of a number."""
    at = kinds.find("t")
    return at >= 0 and at not in usual and at + 1 in sure


def _short(line: str) -> str:
    return line.strip()[:40]


def _headings(
    lines: list[str], layout: _TableLayout, names: Collection[str], table: TextTable
) -> tuple[list[str], list[str]]:
    """Names and units of the columns, from the lines just above the table."""
    width = max(layout.places) + 1

    def split(line: str) -> list[str]:
        line = line.strip().lstrip("#%/ ") if _is_comment(line) else line
        if layout.separator is None and layout.cells == 1:
            return [line.strip().strip('"')]
        cells = _split(line, layout.separator)
        if layout.separator is None:  # a unit in brackets belongs to the name before it
            words, cells = cells, []
            for word in words:
                if cells and word[0] in "([" and len(words) > layout.cells:
                    cells[-1] += f" {word}"
                else:
                    cells.append(word)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        return cells

    def known(cells: list[str]) -> int:
        if any("d" in _kind(cell, True) for cell in cells) or "=" in cells[0]:
            return 0  # a fact and its value
        numbers = any(_NUMBER.fullmatch(cell) for cell in cells)
        return sum(
            bool(cell)
            and (
                (is_time(cell) and unit_of(cell) is None)
                or _is_named(cell, names)
                or (not numbers and cell[0] not in "([{<" and bool(name_and_unit(cell, ())[1]))
            )
            for cell in cells
        )

    def units(cells: list[str]) -> int:
        found = [c for c in cells if c and not _NUMBER.fullmatch(c)]
        bare = [c for c in found if c[0] not in "([{<"
                and (unit_of(c) or c.lower() not in SAMPLE_NUMBERS | _GAPS)]  # fmt: skip
        good = [c for c in found if unit_of(c) or c in UNITS_AT_ENDS or c.lower() == "sequence"]
        if any(_NUMBER.fullmatch(cells[j]) for j in layout.places if j < len(cells)):
            return 0
        return len(good) if not known(cells) and len(good) >= len(bare) else 0

    near = [x for x in lines[: layout.start] if set(_kinds(x, layout.separator)) - {"g"}]
    near = near[-_ROWS_ABOVE:]
    spaces = layout.separator is None
    lengths = {layout.cells} | {
        len(split(x)) for x in near if any(_means(plain_name(c), _INTERVALS) for c in split(x))
    }
    rows = [cells for line in near if len(cells := split(line)) >= width
            and not (spaces and (len(cells) not in lengths or "\t" in line.strip()))
            and (not _is_comment(line) or known(cells))]  # fmt: skip
    unit_row = next((row for row in reversed(rows) if units(row)), [])
    named = [row for row in rows if row is not unit_row and known(row)
             and not all(is_time(row[j]) for j in layout.places)]  # fmt: skip
    heading = max(reversed(named), key=known, default=[])
    if heading and not unit_row and heading is not rows[-1]:
        below = rows[[row is heading for row in rows].index(True) + 1]
        if not any(_NUMBER.fullmatch(below[j]) for j in layout.places):
            unit_row = below  # of units that nobody knows
    if not heading and rows:
        row = rows[-1] if rows[-1] is not unit_row else rows[-2] if len(rows) > 1 else []
        plain = [split(line) for line in near]
        fact = bool(row) and _means(plain_name(row[0]), (*_UNITS_OF_TIME, *_UNITS_OF_VALUES))
        numbers = any(_kind(cell, True) in "nd" for cell in row)
        whole = all(row[j] for j in layout.places[1:]) if row else False
        if row in plain[-2:] and whole and not fact and not numbers and "=" not in row[0]:
            heading = row
    if not heading and near and not unit_row:
        cells = split(near[-1])
        if len(cells) < width and known(cells) and not re.search("[:=]", near[-1]):
            raise TableError(
                f"the heading names {len(cells)} columns and the rows have {width}. Give a name "
                "for each column, and separate the columns by semicolons if numbers have decimal "
                "commas"
            )
    if not heading:
        heading = unit_row
    for place in range(width, max(len(heading), len(unit_row))):
        name = heading[place] if place < len(heading) else ""
        if name and place < len(unit_row) and unit_row[place]:
            table.facts.setdefault(plain_name(name), []).append(unit_row[place])
    for row in rows:
        if any(re.fullmatch(r"[x*\u00d7] ?[\d.]+(e[+-]?\d+|\^[+-]?\d+)?", cell) for cell in row):
            table.facts.setdefault("multiplier", [", ".join(row)])
    unit_row = unit_row + [""] * (width - len(unit_row))
    unused = list(layout.texts)
    for place in layout.texts:  # such as columns "Force" and "Unit"
        inside = {cells[place] for line in lines[layout.start : layout.last + 1]
                  if len(cells := _split(line, layout.separator)) > place}  # fmt: skip
        if place - 1 in layout.places and len(inside) == 1 and unit_of(one := inside.pop()):
            unit_row[place - 1] = unit_row[place - 1] or one
            unused.remove(place)
    texts = [heading[place] if place < len(heading) and heading[place] else str(place + 1)
             for place in unused]  # fmt: skip
    if texts:
        table.notes.append(f"text is not used: column {', '.join(texts)}.")
    return heading, unit_row


def _is_named(cell: str, names: Collection[str]) -> bool:
    """Whether a cell is one of the names, with or without a unit or a number behind it."""
    name = plain_name(name_and_unit(cell, names)[0])
    return name in names or re.sub(r"_?\d+$", "", name) in names


def _comments(lines: list[str]) -> str:
    return "\n".join(line.strip().lstrip("#%/").strip() for line in lines if _is_comment(line))


def _facts(lines: list[str], layout: _TableLayout, table: TextTable) -> None:
    """Keep lines of a name and its values, above the table and in columns beside it."""
    inside = [
        _split(line, layout.separator)[: layout.places[0]]
        for line in lines[layout.start : layout.start + 100]
        if layout.places[0] > 0
    ]
    above = []
    for line in lines[: layout.start]:
        words = line.strip().lstrip("#%/").strip()
        signs = [sign for sign in (layout.separator, "\t", ";", ",", "|") if sign and sign in words]
        if signs and not re.match(r"[\w ]+[:=]", words):
            above.append(_split(words, signs[0]))
            above += [re.split(r"\s*=\s*", cell, maxsplit=1) for cell in above[-1] if "=" in cell]
        else:
            parts = re.split(r"\s*[:=]\s*", words, maxsplit=1)
            above.append([part.strip(" \t,;|") for part in parts])
    for cells in above + inside:
        while cells and not cells[-1]:
            cells.pop()
        while cells and not cells[0]:
            cells = cells[1:]
        if len(cells) > 1 and not _NUMBER.fullmatch(cells[0]):
            table.facts.setdefault(plain_name(cells[0].rstrip(":")), cells[1:])


class _Rows:
    """Reads the rows of a table, a part of the text at a time."""

    def __init__(self, text: str, head: list[str], layout: _TableLayout, notes: list[str]) -> None:
        self.text, self.layout, self.notes = text, layout, notes
        self.at = self.begin = sum(len(line) + 1 for line in head[: layout.start])
        self.line = layout.start
        self.commas: dict[int, str] = {}
        self.points: dict[int, str] = {}
        self.odd: dict[int, tuple[int, str]] = {}
        self.below: list[tuple[int, str]] = []
        self.apart = 0  # comment lines within the table
        self.moments = {place: _Moments() for place in layout.places}

    def read(self) -> list[np.ndarray]:
        """Return the columns, shape (rows,) each. Raises TableError."""
        text, layout = self.text, self.layout
        points = text.find(".", self.at) >= 0
        commas = layout.separator != "," and text.find(",", self.at) >= 0
        found = np.empty((len(layout.places), text.count("\n", self.at) + 1))
        rows = 0
        while self.at < len(text):
            end = text.find("\n", self.at + _CHUNK)
            end = len(text) if end < 0 else end
            chunk = text[self.at : end]
            if commas and not points:
                chunk = chunk.replace(",", ".")
            block = self._block(chunk.split("\n"), bool(layout.dates) or (commas and points))
            found[:, rows : rows + block.shape[1]] = block
            rows += block.shape[1]
            self.at = end + 1
        self._say(rows)
        return [column[:rows] for column in found]

    @property
    def interrupted(self) -> bool:
        """Whether empty lines, or lines of separators alone, stand between rows."""
        end = self.text.find(self.below[0][1], self.begin) if self.below else len(self.text)
        while end > self.begin and self.text[end - 1] in ' \t\n;,|"':
            end -= 1
        start = _FILLED.search(self.text, self.begin, end)
        return start is not None and _EMPTY.search(self.text, start.start(), end) is not None

    def _block(self, lines: list[str], mixed: bool) -> np.ndarray:
        """Columns of some lines, shape (columns, rows); only the unusual ones cell by cell."""
        found = None
        if not self.below and (self.layout.separator is not None or not self.layout.texts):
            found = self._fast(lines, mixed)
        if found is None and len(lines) > 64:
            half = len(lines) // 2
            parts = [self._block(lines[:half], mixed), self._block(lines[half:], mixed)]
            return np.concatenate(parts, axis=1)
        if found is None:
            found = self._slow(lines)
        self.line += len(lines)
        return found

    def _fast(self, lines: list[str], mixed: bool) -> np.ndarray | None:
        """Columns of lines without anything unusual; None of others."""
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
                lines = [_filled(line, separator) for line in lines]
            with suppress(ValueError):
                found = np.loadtxt(
                    lines, delimiter=separator, comments=None, ndmin=2,
                    usecols=None if separator is None else places,
                )  # fmt: skip
                return found.T if found.shape[1] == len(places) else None
        return None

    def _column(self, cells: list[str], place: int) -> list[float]:
        """Values of cells with dates, or with commas beside other columns with points."""
        if place in self.layout.dates:
            return [self.moments[place].seconds(cell.strip()) for cell in cells]
        for sign, seen in ((",", self.commas), (".", self.points)):
            example = next((cell for cell in cells if sign in cell), None)
            if example is not None:
                seen.setdefault(place, example.strip())
        if place in self.commas:
            cells = [cell.replace(",", ".") for cell in cells]
        return [float(cell) for cell in cells]

    def _slow(self, lines: list[str]) -> np.ndarray:
        """Columns of a part, cell by cell, shape (columns, rows)."""
        layout = self.layout
        found: list[list[float]] = []
        for i, raw in enumerate(lines, self.line + 1):
            line = raw.translate(_SAFE)
            if not line.strip():
                continue
            if _is_comment(line):
                self.apart += 1
                continue
            cells = _split(line, layout.separator)
            while len(cells) > layout.cells and not cells[-1]:
                cells.pop()
            if not any(cells):
                continue
            kinds = [_kind(cells[j], True) if j < len(cells) else "g" for j in layout.places]
            if not any(kind in "nd" for kind in kinds) and (
                "t" in kinds
                or all(j >= len(cells) or not cells[j] for j in layout.places)
                or (layout.separator is None and len(cells) != layout.cells)
            ):
                self.below.append((i, line))
                continue
            if self.below:
                at, words = self.below[0]
                raise TableError(
                    f"line {at} '{_short(words)}' stands between rows of numbers. Give a file with "
                    "one table"
                )
            short = layout.separator is None and len(cells) < layout.cells
            if len(cells) > layout.cells or short:
                raise TableError(
                    f"line {i} has {len(cells)} cells and other lines have {layout.cells}. "
                    "Write the file again; it may be cut off, or numbers may have decimal commas "
                    "between columns separated by commas"
                )
            found.append([
                self._number(cells[j], kind, j, i) if j < len(cells) else math.nan
                for j, kind in zip(layout.places, kinds, strict=True)
            ])  # fmt: skip
        return np.array(found).T if found else np.empty((len(layout.places), 0))

    def _number(self, cell: str, kind: str, place: int, line: int) -> float:
        """Value of a cell; nan of a gap. Raises TableError for a number of an unknown form."""
        if (kind == "d") != (place in self.layout.dates) and kind != "g":
            kind = "n" if _NUMBER.fullmatch(cell) and place not in self.layout.dates else "t"
        if kind == "n":
            if "," in cell:
                self.commas.setdefault(place, cell)
                cell = cell.replace(",", ".")
            elif "." in cell:
                self.points.setdefault(place, cell)
            return float(cell.replace("D", "e").replace("d", "e"))
        if kind == "d":
            return self.moments[place].seconds(cell)
        if kind == "t":
            if any(c.isdigit() for c in cell):
                raise TableError(
                    f"line {line}: '{_short(cell)}' in column {place + 1} is not a number that "
                    "can be read in one way. Write numbers without units, and without signs "
                    "between thousands"
                )
            number, example = self.odd.get(place, (0, cell))
            self.odd[place] = number + 1, example
        return math.nan

    def _say(self, rows: int) -> None:
        """Add notes on what is not used. Raises TableError for two decimal signs in a column."""
        for place in self.commas.keys() & self.points.keys():
            raise TableError(
                f"column {place + 1} has numbers with commas and with points, such as "
                f"'{self.commas[place]}' and '{self.points[place]}'. Write one decimal sign"
            )
        for place, (number, example) in self.odd.items():
            self.notes.append(
                f"column {place + 1} has {number} texts in place of numbers, such as '{example}'."
            )
        if len(self.below) > max(20, rows):
            raise TableError(
                f"line {self.below[0][0]} '{_short(self.below[0][1])}' begins {len(self.below)} "
                "lines that do not belong to the table above. Give a file with one table"
            )
        if self.below:
            self.notes.append(
                f"not used below the table: {len(self.below)} lines from "
                f"'{_short(self.below[0][1])}' on."
            )
        if self.apart:
            self.notes.append(f"comment lines in the table are not used: {self.apart}.")


def _filled(line: str, separator: str) -> str:
    """A line with "nan" in empty cells and in place of infinity as Microsoft writes it."""
    if "#" in line:
        line = _OVERFLOW.sub("nan", line)
    if 2 * separator in line or line[0] == separator or line[-1] == separator:
        return separator.join(cell if cell.strip() else "nan" for cell in line.split(separator))
    return line


class _Moments:
    """Seconds of dates and times of day, from the minute of the first one on."""

    def __init__(self) -> None:
        self.first: tuple[int, int] | None = None  # day, and seconds of its whole minutes
        self.known: dict[str, float] = {}
        self.dates: set[str] = set()

    def seconds(self, cell: str) -> float:
        """Seconds of a cell. Raises TableError for dates that can mean two days."""
        head, colon, tail = cell.rpartition(":")
        base = self.known.get(head) if colon else None
        if base is not None:
            try:
                return base + float(tail)
            except ValueError:
                pass
        found = _moment(cell)
        if found is None:
            raise ValueError(cell)
        date, minutes_s, seconds, sure = found
        if date is not None:
            self.dates.add(cell[:8] if not sure else "")
            if len(self.dates) > 1:
                raise TableError(
                    f"the date changes in the table, and '{_short(cell)}' may name the day or the "
                    "month first. Write dates as 2024-12-31"
                )
        self.first = self.first or (date or 0, minutes_s)
        total = 86400 * ((date or 0) - self.first[0]) + minutes_s - self.first[1] + seconds
        if colon and re.fullmatch(r"\d\d(\.\d+)?", tail) and head.count(":") == 1:
            self.known[head] = total - float(tail)
        return total


@functools.lru_cache(maxsize=1 << 10)
def _moment(cell: str) -> tuple[int | None, int, float, bool] | None:
    """Day number, seconds of the day up to the minute, seconds of the minute, and whether the order
    of day and month is sure; None if a cell is neither date nor time of day."""
    days = re.match(r"(\d+) days?,?\s*", cell)  # a duration
    if days:
        rest = _moment(cell[days.end() :] or "0:00")
        return None if rest is None or rest[0] is not None else (int(days[1]), *rest[1:3], True)
    found = _DATE.fullmatch(cell)
    if found is None or not cell or not (found[1] or found[5] or found[8]):
        return None
    day: int | None = None
    sure = True
    if found[1]:
        a, b, c = int(found[1]), int(found[3]), int(found[4])
        sure = len(found[1]) == 4
        try:
            if sure:
                day = datetime.date(a, b, c).toordinal()
            elif b > 12:
                day = datetime.date(c, a, b).toordinal()
            else:
                day = datetime.date(c, b, a).toordinal() if a > 12 else a + 31 * b + 372 * c
        except ValueError:
            return None
    if found[8]:
        return day, 60 * int(found[8]), float(found[9].replace(",", ".")), sure
    if not found[5]:
        return day, 0, 0.0, sure
    whole, *parts = re.split("[.,:]", found[7] or "0")
    hour = int(found[5])
    if found[10]:
        hour = hour % 12 + 12 * (found[10].lower() == "pm")
    return day, 3600 * hour + 60 * int(found[6]), float(f"{whole}.{''.join(parts) or 0}"), sure


# Facts beside a table that give its times and units: "Sample Interval", "Delta_X", "XAxisUnit".
_INTERVALS = ("sample_interval", "sampling_interval", "sample_period", "sampling_period", "delta_x",
              "x_increment", "xinc", "increment", "delta_t", "dt", "time_increment", "time_step",
              "sample_time", "horizontal_interval", "tinc", "hresolution", "x_axis_delta",
              "time_interval", "t_interval")  # fmt: skip
_RATES = ("sample_rate", "sampling_rate", "sampling_frequency", "sample_frequency",
          "samples_per_second", "rate", "fs", "sampling_rate_hz", "sample_rate_hz")  # fmt: skip
_STARTS = ("start", "x0", "x_zero", "x_origin", "xorg", "x_axis_min", "x_start", "hoffset", "t0",
           "t_start")  # fmt: skip
_UNITS_OF_TIME = ("horizontal_units", "x_units", "x_unit", "x_unit_label", "time_unit",
                  "time_units", "horizontal_unit", "hunit", "x_axis_unit")  # fmt: skip
_UNITS_OF_VALUES = ("vertical_units", "y_unit_label", "y_units", "y_unit", "units", "unit",
                    "vertical_unit", "vunit", "y_axis_unit")  # fmt: skip
_SAID = (*_INTERVALS, *_RATES, *_STARTS, "date", "time", "length", "record_length", "points",
         "samples", "size", "block_size", "number_of_values")  # fmt: skip


def _means(name: str, names: Collection[str]) -> bool:
    """Whether a plain name is one of some, with or without underscores."""
    return name.replace("_", "") in {one.replace("_", "") for one in names}


def spacing_s(table: TextTable) -> tuple[float, float, str] | None:
    """Time between rows and time of the first, s, and the fact that says so; None if none does.

    Raises:
        TableError: two facts disagree, or one has an unknown unit.
    """
    found: list[tuple[float, str]] = []
    unit = unit_of(stated(table, _UNITS_OF_TIME)) or StatedUnit("s", 1.0, "s")
    for name, cells in table.facts.items():
        stem, own = name_and_unit(name, (*_INTERVALS, *_RATES))
        is_rate = _means(stem, _RATES)
        if not cells or not (is_rate or _means(stem, _INTERVALS)):
            continue
        parts = re.fullmatch(rf"({_NUMBER.pattern})\s*(\D*)", cells[0].strip())
        if parts is None:
            continue
        value = float(parts[1].replace(",", "."))
        given = parts[2] or own or (cells[1] if len(cells) > 1 and unit_of(cells[1]) else "")
        size = unit_of(given) if given else StatedUnit("Hz", 1.0, "Hz") if is_rate else unit
        if size is None or value <= 0.0 or size.si != ("Hz" if is_rate else "s"):
            raise TableError(f"'{name}' = '{cells[0]}' has no known unit of time")
        step = value * size.size
        found.append((1.0 / step if is_rate else step, name))
    if not found:
        return None
    if any(abs(step - found[0][0]) > 1e-3 * step for step, _ in found):
        said = " and ".join(f"'{name}' ({step:.9g} s)" for step, name in found)
        raise TableError(f"{said} disagree about the time between samples")
    start = stated(table, _STARTS).replace(",", ".")
    at = float(start) * unit.size if _NUMBER.fullmatch(start) else 0.0
    return found[0][0], at, found[0][1]


def stated(table: TextTable, names: Collection[str], place: int = 0) -> str:
    """Value of the first fact that has one of the names, "" if there is none."""
    for wanted in names:
        if cells := next((c for name, c in table.facts.items() if _means(name, [wanted])), None):
            return cells[min(place, len(cells) - 1)].rpartition(":")[2]  # as in "CH1:V"
    return ""


def stated_unit(table: TextTable, time: bool, place: int = 0) -> str:
    """Unit that lines beside the table state for times, or for the n-th column of values."""
    return stated(table, _UNITS_OF_TIME if time else _UNITS_OF_VALUES, place)
