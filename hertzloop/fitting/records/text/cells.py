"""Cells of a line, and what they are: numbers, dates, gaps and texts.

A kind is one letter: "n" number, "d" date or time of day, "g" gap, "t" text. The kinds of a line
are a string with one letter for each cell.
"""

import csv
import functools
import re

from hertzloop.fitting.records.text.dates import parse_date_or_time

_COMMENT = ("#", "%", "//")
NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+-]?\d+)?")
OVERFLOW = re.compile(r"[+-]?1[.,]#\w+")  # as Microsoft's library writes infinity and nan
GAPS = frozenset(
    {
        "",
        "nan",
        "inf",
        "infinity",
        "n/a",
        "#n/a",
        "na",
        "null",
        "none",
        "-",
        "--",
        "---",
        "*",
        "**",
        "***",
        "****",
        "?",
        "ovl",
        "ovld",
        "ol",
        "over",
        "overflow",
        "overload",
        "overrange",
        "invalid",
        "nil",
        "missing",
        "#num!",
        "#value!",
        "#div/0!",
        "\u221e",
        "no data",
        "clipped",
        "<na>",
        "nat",
    }
)
PLAIN_SIGNS = str.maketrans({"\u2212": "-", "\u00a0": " ", "\u202f": " "})


def split_cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without quotes and spaces around them."""
    if '"' in line:
        found = next(csv.reader([line], delimiter=separator or " ", skipinitialspace=True), [])
        return [cell.strip() for cell in found]
    if separator is None:
        return line.split()
    return [cell.strip() for cell in line.split(separator)]


@functools.lru_cache(maxsize=1 << 14)
def cell_kind(cell: str, decimal_comma: bool) -> str:
    """Return the kind of a cell. `decimal_comma`: whether a number may have one."""
    if NUMBER.fullmatch(cell):
        return "n" if decimal_comma or "," not in cell else "t"
    if cell.lower().lstrip("+-") in GAPS or cell.lower() in GAPS or OVERFLOW.fullmatch(cell):
        return "g"
    return "d" if any(c in cell for c in ":-/.") and parse_date_or_time(cell) is not None else "t"


def line_kinds(line: str, separator: str | None) -> str:
    """Return the kinds of a line's cells; "" of an empty line, and of one with empty cells only."""
    cells = split_cells(line, separator)
    if not any(cells):
        return ""
    return "".join(cell_kind(cell, separator != "," or '"' in line) for cell in cells)


def is_comment(line: str) -> bool:
    """Whether a line begins with the sign of a comment, and not with that of an invalid value."""
    words = line.lstrip().lower()
    return words.startswith(_COMMENT) and not words.startswith(
        ("#n/a", "#num!", "#value!", "#div/")
    )


def text_places(kinds: str) -> list[int]:
    """Return the places of texts in the kinds of a line."""
    return [j for j, c in enumerate(kinds) if c == "t"]
