"""What every command prints with: two consoles, errors, progress, interruptions."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from hertzloop.processes.signals import INTERRUPTED, on_interrupt

# Text is printed as it is: it may come from scenes, files and other processes, and a name such as
# [red] or 0:100:1 has no meaning here.
out = Console(highlight=False, emoji=False, markup=False)
err = Console(stderr=True, highlight=False, emoji=False, markup=False)


def be_quiet() -> None:
    """Print nothing but errors, and what --json - writes to standard output."""
    out.quiet = True


def fail(sentence: str, code: int) -> NoReturn:
    """Print an error and end the command with this exit code."""
    err.print(Text.assemble(("error:", "red"), f" {sentence}"), soft_wrap=True)
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
    """Show a progress bar with the time left, gone when done; yields a function that takes how much
    of `total` is completed."""
    percent = TextColumn("{task.percentage:3.0f} %", markup=False)
    about = TextColumn("{task.description}", markup=False)
    columns = (about, BarColumn(), percent, TimeRemainingColumn())
    hidden = out.quiet or not err.is_terminal
    with Progress(*columns, console=err, transient=True, disable=hidden) as bar:
        task = bar.add_task(what, total=total)
        yield lambda completed: bar.update(task, completed=completed)
