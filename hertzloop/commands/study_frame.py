"""What the commands of studies share: a folder for results, a table of numbers."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.table import Table

from hertzloop.commands.options import announce_compilation, make_folder
from hertzloop.commands.terminal import fail


def numbers(title: str, headings: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    """A table of numbers, ready as text."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(*row)
    return table


@contextmanager
def results_in(folder: Path, *schemes: str) -> Iterator[None]:
    """A study that writes into `folder`, which is made, with the kernels of `schemes` ready."""
    from hertzloop.commands.warmup import ensure_compiled

    make_folder(folder)
    for scheme in schemes:
        ensure_compiled(announce_compilation, scheme)
    try:
        yield
    except OSError as error:
        fail(f"cannot write into {folder}: {error.strerror}", 1)
