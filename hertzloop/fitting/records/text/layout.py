"""Find the table in the lines of a text: its first line, its separator and its columns."""

import re
import statistics
from itertools import takewhile
from typing import NamedTuple

from hertzloop.fitting.records.errors import TableError, shorten
from hertzloop.fitting.records.text.cells import (
    OVERFLOW,
    cell_kind,
    is_comment,
    line_kinds,
    split_cells,
    text_places,
)
from hertzloop.fitting.records.text.fact_names import STATED_FACTS, is_one_of
from hertzloop.fitting.records.units import plain_name


class TableLayout(NamedTuple):
    """Where the table is.

    Attributes:
        start: number of its first line, from 0 on.
        separator: between cells; None for spaces.
        places: of its columns of numbers, from 0 on.
        dates: those of them with dates or times of day.
        cells: number of cells in a row.
        texts: places of columns of text.
        last: number of the last line that was looked at.
    """

    start: int
    separator: str | None
    places: tuple[int, ...]
    dates: frozenset[int]
    cells: int
    texts: tuple[int, ...]
    last: int

    @property
    def width(self) -> int:
        """Cells up to the last column of numbers."""
        return max(self.places) + 1


class TableCandidate(NamedTuple):
    """A table by one separator: number of rows, whether it is without columns of text, layout."""

    rows: int
    clean: bool
    layout: TableLayout


def find_table(lines: list[str]) -> TableLayout | None:
    """Return the layout of the table, by the separator that makes the longest and cleanest one;
    None if there is no table. Raises TableError for commas that can be read in two ways."""
    given = next((line for line in lines if line.strip()), "").strip().strip('"')
    forced = re.fullmatch(r"sep=(.)", given, re.IGNORECASE)
    tried = [forced[1]] if forced else ["\t", ";", "|", ",", None]
    runs = (_find_by_separator(lines, separator, forced is not None) for separator in tried)
    found = [one for one in runs if one is not None]
    if not found:
        return None
    # A table ends the file, but for a few lines below it.
    latest = max(one.layout.last for one in found)
    found = [one for one in found if one.layout.last > latest - 4]
    most = max(one.rows for one in found)
    best = max(found, key=lambda one: (one.rows >= 0.9 * most, one.clean))  # the first of these
    if best.layout.separator == "," and not forced:
        single = _find_by_separator(lines, None, False)
        if single is not None and _commas_are_decimal(lines, best.layout):
            return single.layout
    return best.layout


def refuse_rows_above(lines: list[str], layout: TableLayout) -> None:
    """Raise TableError for rows of numbers above the line that begins the table."""
    above = [line_kinds(line, layout.separator) for line in lines[: layout.start]]
    rows = [
        i
        for i, k in enumerate(above)
        if len(k) == layout.cells
        and all(k[j] in "nd" for j in layout.places)
        and all(c in "ndg" or j in layout.texts for j, c in enumerate(k))
    ]
    between = [i for i in range(rows[-1] + 1, layout.start) if above[i]] if rows else []
    if len(rows) > 1 or len(between) == 1:
        at = (between or rows)[0]
        raise TableError(
            f"line {at + 1} '{shorten(lines[at])}' stands between rows of numbers. Give a file "
            "with one table"
        )


def reaches_end(layout: TableLayout, lines: list[str], end: str) -> bool:
    """Whether a table reaches from the first half of the lines to the end of the text."""
    tail = [line_kinds(line, layout.separator) for line in end.split("\n")[1:] if line.strip()][-8:]
    return 2 * layout.start < len(lines) < layout.last + 20 and any(
        all(kinds[j : j + 1] in ("n", "d") for j in layout.places) for kinds in tail
    )


def _find_by_separator(
    lines: list[str], separator: str | None, forced: bool
) -> TableCandidate | None:
    """Return the table by one separator, None if there is none. `forced`: the file names it."""
    kinds = ["" if is_comment(line) else line_kinds(line, separator) for line in lines]
    back = [i for i in range(len(kinds) - 1, -1, -1) if kinds[i]]
    last = next((i for least in (3, 2, 1) for i in back if _rows_alike(kinds, i, least)), None)
    if last is None or not (
        forced or separator is None or any(separator in lines[i] for i in back[:3])
    ):
        return None
    sure = {j for j, c in enumerate(kinds[last]) if c in "nd"}
    usual = set(text_places(kinds[last]))
    rows, places, start = _rows_up_from(kinds, last, sure, usual)
    # Facts whose values stand in the places of the numbers, and those in places of their own.
    top = list(takewhile(lambda i: _fact_beside_number(kinds[i], usual, sure), reversed(rows)))
    names = [plain_name(split_cells(lines[i], separator)[kinds[i].index("t")]) for i in top]
    if 0 < len(top) < len(rows) and (len(set(names)) > 1 or is_one_of(names[0], STATED_FACTS)):
        rows = rows[: -len(top)]
        start = rows[-1]
    places = {
        j
        for j in places
        if j in sure
        or any(
            kinds[i][j : j + 1] in ("n", "d") and not set(text_places(kinds[i][:j])) - usual
            for i in rows
        )
    }
    texts = {j for i in rows for j in text_places(kinds[i])} - sure
    kept = tuple(sorted(places - texts))
    if not kept:
        return None
    columns = {j: "".join(kinds[i][j : j + 1] for i in rows) for j in places | texts}
    dates = frozenset(j for j in kept if columns[j].count("d") > columns[j].count("n"))
    cells = statistics.median_high(len(kinds[i]) for i in rows)
    many = {j for j in texts if 2 * columns[j].count("t") > len(rows)}
    for j in many:
        texts_there = [split_cells(lines[i], separator)[j] for i in rows if j < len(kinds[i])]
        if not _can_be_text_column(texts_there, separator, left=j < kept[0]):
            return None
    layout = TableLayout(start, separator, kept, dates, cells, tuple(sorted(texts)), last)
    return TableCandidate(len(rows), not many, layout)


def _rows_up_from(
    kinds: list[str], last: int, sure: set[int], usual: set[int]
) -> tuple[list[int], set[int], int]:
    """Go up from the last row of a table as long as lines look like its rows.

    Args:
        kinds: of the cells of each line.
        last: number of the last row.
        sure: places of its numbers.
        usual: places of its texts.

    Returns:
        Numbers of the rows from the last to the first, places of numbers, and the first row.
    """
    places, rows, start = set(sure), [], last
    for i in range(last, -1, -1):
        if set(kinds[i]) <= {"g"} or all(kinds[i][j : j + 1] == "g" for j in sure):
            continue
        here = {j for j, c in enumerate(kinds[i]) if c in "nd"}
        wrong = set(text_places(kinds[i]))
        if wrong & sure or not here & (sure | places):
            # A text in place of a number stays in the table if rows follow above it.
            above = [k for k in kinds[max(0, i - 12) : i] if k][-3:]
            fits = [
                k
                for k in above
                if all(k[j : j + 1] in ("n", "d", "g") for j in sure)
                and set(text_places(k)) <= usual
            ]
            if len(fits) < 2:
                break
            if here & sure:
                rows.append(i)
            continue
        places = (places | here) - (wrong - sure)
        rows.append(i)
        start = i
    return rows, places, start


def _can_be_text_column(texts: list[str], separator: str | None, left: bool) -> bool:
    """Whether texts are a column of the table. A text with another separator in it is several
    cells; names of facts stand on the `left` and differ from line to line."""
    if re.search(r"[;|\t]" if separator else r"[;|\t]|,[-+]?[\d.]", texts[0]):
        return False
    return not left or len(set(texts)) <= 0.5 * len(texts) + 1


def _rows_alike(kinds: list[str], i: int, least: int) -> bool:
    """Whether a line and those before it are rows of one table."""
    before = [k for k in kinds[max(0, i - 12) : i + 1] if k][-least:]
    texts = {tuple(text_places(k)) for k in before}
    numbers = [{j for j, c in enumerate(k) if c in "nd"} for k in before]
    return len(texts) == 1 and bool(set.intersection(*numbers))


def _commas_are_decimal(lines: list[str], layout: TableLayout) -> bool:
    """Whether commas that seem to separate whole numbers are decimal. Raises TableError if nothing
    tells one from the other."""
    rows = [line.strip() for line in lines[layout.start :] if line.strip()]
    if layout.cells > 2 or any(
        "." in OVERFLOW.sub("", x) or cell_kind(x, True) == "t" for x in rows
    ):
        return False
    above = [
        x
        for x in lines[: layout.start]
        if x.strip() and not is_comment(x) and cell_kind(x.strip(), True) == "t"
    ]
    if not above:
        raise TableError(
            f"line {layout.start + 1} '{shorten(rows[0])}' may hold two whole numbers or one with "
            "a decimal comma. Give a line with the names of the columns"
        )
    return "," not in above[-1]


def _fact_beside_number(kinds: str, usual: set[int], sure: set[int]) -> bool:
    """Whether the first text of a row stands where rows have none, just left of a number."""
    at = kinds.find("t")
    return at >= 0 and at not in usual and at + 1 in sure
