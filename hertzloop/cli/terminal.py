"""What every command prints with: two consoles, errors, progress, interruptions."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn, Protocol

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.text import Text

from hertzloop.common.optional_dependencies import sentence_on
from hertzloop.common.sanitize import visible
from hertzloop.processes.signals import INTERRUPTED

_LINE_S = 10.0  # between two lines on progress


class Advance(Protocol):
    """How far something is, of its total, and in what words to say so."""

    def __call__(self, completed: int, about: str = ..., /) -> None: ...


class Terminal(Console):
    """A console for text that may come from scenes, files and other processes: a name such as
    [red] or 0:100:1 has no meaning here, and no character in it controls the terminal."""

    def __init__(self, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, emoji=False, markup=False)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """Render as rich does, with all text made visible; the styles are rich's own."""
        for segment in super().render(renderable, options):
            text, style, control = segment
            yield segment if control else Segment(visible(text), style)

    def say(self, sentence: str | Text) -> None:
        """Print a sentence on one line, which the terminal breaks where it has to."""
        self.print(sentence, soft_wrap=True)


out = Terminal()
err = Terminal(stderr=True)


def be_quiet() -> None:
    """Print nothing but errors, and what --json - writes to standard output."""
    out.quiet = True


def fail(sentence: str, code: int = 2) -> NoReturn:
    """Print an error and end the command; exit code 2 says that the mistake is the user's."""
    err.say(Text.assemble(("error:", "red"), f" {sentence}"))
    raise typer.Exit(code)


@contextmanager
def if_interrupted(explain: Callable[[], str] | None = None) -> Iterator[None]:
    """End the command with exit code 130 when a signal ends what is inside; say what is kept."""
    try:
        yield
    except KeyboardInterrupt:
        err.say(f"interrupted; {explain()}" if explain else "interrupted")
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def explained() -> Iterator[None]:
    """End the command in one sentence for an interruption that nothing inside explains, for a
    missing package that an extra brings, and for an error with an `exit_status`: 2 of the user's
    mistake, 1 of a failed run."""
    out.stderr = False  # --json - changes it
    try:
        with if_interrupted():
            yield
    except ModuleNotFoundError as error:
        sentence = sentence_on(error.name)
        if sentence is None:
            raise
        fail(sentence)
    except Exception as error:
        if not hasattr(error, "exit_status"):
            raise
        fail(str(error), error.exit_status)


@contextmanager
def progress(
    what: str, total: int, auto_refresh: bool = True, lines: bool = False
) -> Iterator[Advance]:
    """Show a progress bar with the time left, gone when done; with `lines`, where standard error
    is no terminal, a line every 10 s instead. Yields a function that takes how much of `total` is
    completed, and other words than `what`. Without `auto_refresh` no thread redraws the bar: it
    would disturb a measurement."""
    percent = TextColumn("{task.percentage:3.0f} %", markup=False)
    about = TextColumn("{task.description}", markup=False)
    columns = (about, BarColumn(), percent, TimeRemainingColumn())
    hidden = out.quiet or not err.is_terminal
    with Progress(
        *columns, console=err, transient=True, disable=hidden, auto_refresh=auto_refresh
    ) as bar:
        task = bar.add_task(what, total=total)
        bar.refresh()
        before, said = 0, time.monotonic()

        def advance(completed: int, about: str = what) -> None:
            nonlocal before, said
            bar.update(task, completed=completed, description=about, refresh=not auto_refresh)
            now = time.monotonic()
            if (
                not lines
                or err.is_terminal
                or out.quiet
                or now < said + _LINE_S
                or completed <= before
            ):
                return
            left_s = (total - completed) * (now - said) / (completed - before)
            before, said = completed, now
            err.say(f"{about}, about {left_s:.0f} s left")

        yield advance
