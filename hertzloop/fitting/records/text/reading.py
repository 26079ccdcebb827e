"""Read the table of a text file."""

import codecs
import re
from pathlib import Path

from hertzloop.fitting.records.errors import TableError
from hertzloop.fitting.records.text.cells import NUMBER, PLAIN_SIGNS
from hertzloop.fitting.records.text.facts import comment_text, read_facts
from hertzloop.fitting.records.text.headings import read_headings
from hertzloop.fitting.records.text.layout import find_table, reaches_end, refuse_rows_above
from hertzloop.fitting.records.text.rows import RowReader
from hertzloop.fitting.records.text.table import TextColumn, TextTable
from hertzloop.fitting.records.units import unit_of

_DURATION = re.compile(rf"^({NUMBER.pattern}) (sec|min|hr)(?=[,;\t])", re.MULTILINE)


def read_table(path: Path) -> TextTable:
    """Read the table of a text file.

    Args:
        path: the file, in UTF-8, UTF-16 or an encoding of Windows.

    Raises:
        TableError: there is no table, or there are several.
        OSError: the file cannot be read.
    """
    return read_text(decode_text(path.read_bytes()))


def read_text(text: str) -> TextTable:
    """Read the table of a text. Raises TableError: there is no table, or there are several."""
    if "\r" in text:
        text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    text = text.translate(PLAIN_SIGNS)
    inside = {unit for _, unit in _DURATION.findall(text[-2000:])}
    text = _DURATION.sub(r"\1", text) if len(inside) == 1 else text
    lines: list[str] = []
    layout = None
    for most in (300, 3000, 30_000):  # a long preamble needs more lines
        lines = text.split("\n", most)[:most]
        layout = find_table(lines)
        if len(lines) < most or (layout is not None and reaches_end(layout, lines, text[-2000:])):
            break
    if layout is None:
        return TextTable([], comments=comment_text(lines), above=sum(1 for x in lines if x.strip()))
    refuse_rows_above(lines, layout)
    table = TextTable([], above=sum(1 for line in lines[: layout.start] if line.strip()))
    table.comments = comment_text(lines[: layout.start])
    headings, units = read_headings(lines, layout, table)
    read_facts(lines, layout, table.facts)
    rows = RowReader(text, lines, layout, table.notes)
    values = rows.read()
    for place, found in zip(layout.places, values, strict=True):
        heading, unit = headings[place], units[place]
        unit = inside.pop() if place == 0 and len(inside) == 1 else unit
        if not unit and len(heading) > 3 and unit_of(heading):  # such as "Second"
            unit = heading
        table.columns.append(TextColumn(heading, unit, place + 1, found, place in layout.dates))
    only = table.columns[0].values
    if len(table.columns) == 1 and not table.columns[0].heading and only[0] == len(only) - 1:
        raise TableError(f"its first number, {only[0]:g}, counts those below it. Remove it")
    table.interrupted = rows.interrupted
    return table


def decode_text(raw: bytes) -> str:
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
