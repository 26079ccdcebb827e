"""Results of a study as CSV."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """One line a row under a header."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_records(path: Path, records: Sequence[Any]) -> None:
    """Instances of one dataclass, at least one, a line each; the fields are the columns."""
    names = [field.name for field in fields(records[0])]
    write_rows(path, names, (astuple(record) for record in records))
