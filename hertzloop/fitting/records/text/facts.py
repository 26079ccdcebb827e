"""Facts beside a table: lines of a name and its values."""

import re

from hertzloop.fitting.records.text.cells import NUMBER, is_comment, split_cells
from hertzloop.fitting.records.text.layout import TableLayout
from hertzloop.fitting.records.units import plain_name


def read_facts(lines: list[str], layout: TableLayout, facts: dict[str, list[str]]) -> None:
    """Add the facts above a table and in columns beside it to other ones, by their plain names."""
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
            facts.setdefault(plain_name(cells[0].rstrip(":")), cells[1:])


def comment_text(lines: list[str]) -> str:
    """Return the lines of comments without their signs."""
    return "\n".join(line.strip().lstrip("#%/").strip() for line in lines if is_comment(line))
