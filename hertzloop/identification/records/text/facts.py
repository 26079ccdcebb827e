"""Facts beside a table, such as the time between samples, and units of columns."""

import re
from collections.abc import Collection

from hertzloop.identification.records.errors import TableError
from hertzloop.identification.records.text.cells import NUMBER, is_comment, split_cells
from hertzloop.identification.records.text.fact_names import (
    INTERVAL_FACTS,
    RATE_FACTS,
    START_FACTS,
    TIME_UNIT_FACTS,
    VALUE_UNIT_FACTS,
    is_one_of,
)
from hertzloop.identification.records.text.layout import TableLayout
from hertzloop.identification.records.text.table import StatedSpacing, TextTable
from hertzloop.identification.records.units import StatedUnit, name_and_unit, plain_name, unit_of


def stated_spacing(table: TextTable) -> StatedSpacing | None:
    """Return the time between rows that a fact states; None if none does.

    Raises:
        TableError: two facts disagree, or one has an unknown unit.
    """
    found: list[tuple[float, str]] = []
    unit = unit_of(stated_fact(table, TIME_UNIT_FACTS)) or StatedUnit("s", 1.0, "s")
    for name, cells in table.facts.items():
        stem, own = name_and_unit(name, (*INTERVAL_FACTS, *RATE_FACTS))
        is_rate = is_one_of(stem, RATE_FACTS)
        if not cells or not (is_rate or is_one_of(stem, INTERVAL_FACTS)):
            continue
        parts = re.fullmatch(rf"({NUMBER.pattern})\s*(\D*)", cells[0].strip())
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
    start = stated_fact(table, START_FACTS).replace(",", ".")
    at = float(start) * unit.size if NUMBER.fullmatch(start) else 0.0
    return StatedSpacing(found[0][0], at, found[0][1])


def stated_fact(table: TextTable, names: Collection[str], place: int = 0) -> str:
    """Return the value of the first fact with one of the names, "" if there is none."""
    for wanted in names:
        if cells := next((c for name, c in table.facts.items() if is_one_of(name, [wanted])), None):
            return cells[min(place, len(cells) - 1)].rpartition(":")[2]  # as in "CH1:V"
    return ""


def stated_unit(table: TextTable, time: bool, place: int = 0) -> str:
    """Return the unit that lines beside the table state for times, or for a column of values."""
    return stated_fact(table, TIME_UNIT_FACTS if time else VALUE_UNIT_FACTS, place)


def read_facts(lines: list[str], layout: TableLayout, table: TextTable) -> None:
    """Keep lines of a name and its values, above the table and in columns beside it."""
    inside = [
        split_cells(line, layout.separator)[: layout.places[0]]
        for line in lines[layout.start : layout.start + 100]
        if layout.places[0] > 0
    ]
    above = []
    for line in lines[: layout.start]:
        words = line.strip().lstrip("#%/").strip()
        signs = [sign for sign in (layout.separator, "\t", ";", ",", "|") if sign and sign in words]
        if signs and not re.match(r"[\w ]+[:=]", words):
            above.append(split_cells(words, signs[0]))
            above += [re.split(r"\s*=\s*", cell, maxsplit=1) for cell in above[-1] if "=" in cell]
        else:
            parts = re.split(r"\s*[:=]\s*", words, maxsplit=1)
            above.append([part.strip(" \t,;|") for part in parts])
    for cells in above + inside:
        while cells and not cells[-1]:
            cells.pop()
        while cells and not cells[0]:
            cells = cells[1:]
        if len(cells) > 1 and not NUMBER.fullmatch(cells[0]):
            table.facts.setdefault(plain_name(cells[0].rstrip(":")), cells[1:])


def comment_text(lines: list[str]) -> str:
    """Return the lines of comments without their signs."""
    return "\n".join(line.strip().lstrip("#%/").strip() for line in lines if is_comment(line))
