"""Where words for people go, and how a command gives up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from typer.core import TyperGroup

from hertzloop.extras import sentence_on
from hertzloop.processes.signals import INTERRUPTED, on_interrupt
from hertzloop.views.format import styled

# Text is text: what is shown comes from scenes, files and other processes, and a name such as
# [red] or 0:100:1 has no meaning here. What is to have a style says so with `styled`.
out = Console(highlight=False, emoji=False, markup=False)
err = Console(stderr=True, highlight=False, emoji=False, markup=False)


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
