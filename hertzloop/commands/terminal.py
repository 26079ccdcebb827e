"""Where words for people go, and how a command gives up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any, NoReturn

import typer
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable
from rich.text import Text
from typer.core import TyperGroup

from hertzloop.extras import sentence_on
from hertzloop.processes.signals import INTERRUPTED, on_interrupt

# Text is text: what is shown comes from scenes, files and other processes, and a name such as
# [red] or 0:100:1 has no meaning here. What is to have a style says so with `styled`.
out = Console(highlight=False, emoji=False, markup=False)
err = Console(stderr=True, highlight=False, emoji=False, markup=False)


class Table(RichTable):
    """A table of which no cell is cut: it keeps all words whole where they fit side by side, and
    breaks long ones where they do not."""

    def __init__(self, *headings: str, title: str | None = None, show_header: bool = True) -> None:
        super().__init__(title=title, title_justify="left", show_header=show_header)
        for heading in headings:
            self.add_column(heading)

    def add_column(self, *args: Any, **options: Any) -> None:
        """Add a column; see rich."""
        super().add_column(*args, **{"overflow": "fold", **options})

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Give every column its longest word and let the narrowest grow first; where even these
        words do not fit, break those of the widest columns first, so that numbers stay whole."""
        sizes = [
            [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
            for column in self.columns
        ]
        least = [max(size.minimum for size in column) for column in sizes]
        most = [max(size.maximum for size in column) for column in sizes]
        room = options.max_width - 3 * len(sizes) - 1  # padding and rules
        levels = range(max(most, default=1), 0, -1)
        grown = ([min(b, max(a, level)) for a, b in zip(least, most, strict=True)]
                 for level in levels)  # fmt: skip
        broken = ([min(a, level) for a in least] for level in levels)
        widths = next((w for w in chain(grown, broken) if sum(w) <= room), [1] * len(sizes))
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)


def styled(*pieces: str | tuple[str, str]) -> Text:
    """Text of pieces, each a string or (string, style)."""
    return Text.assemble(*pieces)


def fail(sentence: str, code: int) -> NoReturn:
    """Say what is wrong and end the command with an exit code."""
    err.print(styled(("error:", "red"), f" {sentence}"), soft_wrap=True)
    raise typer.Exit(code)


@contextmanager
def if_interrupted(explain: Callable[[], str] | None = None) -> Iterator[None]:
    """End the command with exit code 130 when a signal ends what is inside; say what is kept."""

    def end(_: str) -> NoReturn:
        err.print(f"interrupted; {explain()}" if explain else "interrupted", soft_wrap=True)
        raise typer.Exit(INTERRUPTED)

    with on_interrupt(end):
        yield


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with the time left, gone when done; yields how to say what is completed."""
    percent = TextColumn("{task.percentage:3.0f} %", markup=False)
    about = TextColumn("{task.description}", markup=False)
    columns = (about, BarColumn(), percent, TimeRemainingColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        yield lambda completed: bar.update(task, completed=completed)


class Commands(TyperGroup):
    """All commands: an interruption that none of them explains ends in one sentence, as does a
    package that an extra would have brought."""

    def invoke(self, *args: Any) -> Any:
        """Run the command that was asked for."""
        out.stderr = False  # see check_json
        try:
            with if_interrupted():
                return super().invoke(*args)
        except ModuleNotFoundError as error:
            sentence = sentence_on(error.name)
            if sentence is None:
                raise
            fail(sentence, 2)
