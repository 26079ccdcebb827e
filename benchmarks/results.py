"""What a program writes: tables on the terminal, CSV files, pictures, and its conclusion."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

from benchmarks.scenes import load
from hertzloop.cli.outputs import make_folder
from hertzloop.cli.prepare import compile_first
from hertzloop.cli.terminal import fail, out
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.pages.words import write_rows
from hertzloop.views.format import Table

_OF_SCHEME = {"thesis2008": "thesis-aluminium"}  # a scheme that the default scene does not fit

# The columns of a table: heading, and how a row becomes text. A format such as "{.median_us:.3g}"
# takes an attribute of the row, "{[0]}" an item, and a function makes the text itself.
Columns = Mapping[str, str | Callable[[Any], str]]


class Results:
    """The results of one program.

    Attributes:
        folder: folder that takes the files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: list[str] = []

    def path(self, name: str) -> Path:
        """Where to write the file of a name, such as "stability.png"; it is listed at the end."""
        self._files.append(name)
        return self.folder / name

    def write_rows(self, name: str, header: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
        """Write NAME.csv, one line a row."""
        write_rows(self.path(f"{name}.csv"), header, map(list, rows))

    def write(self, name: str, records: Sequence[Any]) -> None:
        """Write instances of one dataclass, at least one, to NAME.csv.

        A record is a line; the fields are the columns.
        """
        self.write_rows(name, [field.name for field in fields(records[0])], map(astuple, records))

    def table(
        self, title: str, columns: Columns, rows: Iterable[Any], text: int = 1, caption: str = ""
    ) -> None:
        """Print a table.

        Args:
            title: title above the table.
            columns: heading and format of each column.
            rows: one object for each row.
            text: number of columns at the left that hold text.
            caption: line below the table.
        """
        headings = list(columns)
        table = Table(*headings[:text], right=headings[text:], title=title)
        table.caption = caption or None
        for row in rows:
            table.add_row(
                *(
                    cell.format(row) if isinstance(cell, str) else cell(row)
                    for cell in columns.values()
                )
            )
        out.print(table)

    def conclude(self, sentence: str) -> None:
        """Print which files were written and the conclusion."""
        out.say(f"written: {self.folder}/{', '.join(self._files)}")
        out.say(sentence)
        sys.stdout.flush()


@contextmanager
def results_in(folder: Path | None, program: str, *schemes: str) -> Iterator[Results]:
    """Make the folder for results, compile the kernels of `schemes`, and report a full disk.

    Args:
        folder: the folder that the user named, or None for one named `program`.
        program: name of the program.
        schemes: names of schemes whose kernels are compiled before anything is measured.

    Yields:
        The results, whose folder exists.
    """
    folder = folder or Path(program)
    need("matplotlib")
    make_folder(folder)
    for scheme in schemes:
        compile_first(load(_OF_SCHEME.get(scheme, DEFAULT), [f"run.scheme={scheme}"]))
    try:
        yield Results(folder)
    except OSError as error:
        fail(f"cannot write to the folder {folder}: {error.strerror}", 1)
