"""Where words for people go, and how a command gives up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

# Without emoji: a range such as 0:100:1 has a name between colons.
out = Console(highlight=False, emoji=False)
err = Console(stderr=True, highlight=False, emoji=False)


def fail(sentence: str, code: int) -> NoReturn:
    """Say what is wrong and end the command with an exit code."""
    err.print(f"[red]error:[/red] {escape(sentence)}", soft_wrap=True, markup=True)
    raise typer.Exit(code)


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with the time left, gone when done; yields how to say what is completed."""
    percent = TextColumn("{task.percentage:3.0f} %")
    columns = (TextColumn("{task.description}"), BarColumn(), percent, TimeRemainingColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        yield lambda completed: bar.update(task, completed=completed)
