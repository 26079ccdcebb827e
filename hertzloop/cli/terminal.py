"""Terminal output of all commands: two consoles, errors, progress, interruptions."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn, Protocol

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.text import Text

from hertzloop.common.optional_dependencies import sentence_on
from hertzloop.common.sanitize import visible
from hertzloop.processes.signals import INTERRUPTED

if TYPE_CHECKING:
    from hertzloop.recordings.recording import Recording

_LINE_S = 10.0  # between two lines on progress


class Advance(Protocol):
    """Function that takes how much of a total is completed, and the text of the progress bar."""

    def __call__(self, completed: int, about: str = ..., /) -> None: ...


class Terminal(Console):
    """A console for text from scenes, files and other processes.

    Markup such as [red] has no meaning in it, and no character of it controls the terminal.
    """

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


def set_quiet(quiet: bool) -> None:
    """Print only errors, and the JSON of `--json -` on standard output, or print everything."""
    out.quiet = quiet


def fail(sentence: str, code: int = 2) -> NoReturn:
    """Print an error and end the command.

    Args:
        sentence: What is wrong, and what to do.
        code: Exit code: 2 for a mistake of the user, 1 for a failed run.
    """
    err.say(Text.assemble(("error:", "red"), f" {sentence}"))
    raise typer.Exit(code)


def say_problems(recording: "Recording") -> None:
    """Print what is missing or damaged in a recording."""
    for problem in recording.problems:
        err.say(f"{recording.path}: {problem}")


@contextmanager
def if_interrupted(explain: Callable[[], str] | None = None) -> Iterator[None]:
    """End the command with exit code 130 if a signal interrupts the context.

    Args:
        explain: Returns a sentence on what is kept, to print.
    """
    try:
        yield
    except KeyboardInterrupt:
        err.say(f"interrupted; {explain()}" if explain else "interrupted")
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def explained() -> Iterator[None]:
    """End the command with one sentence for an interruption or an error.

    It catches interruptions that nothing inside has explained, missing packages of an extra, and
    errors with an `exit_status`: 2 for a mistake of the user, 1 for a failed run.
    """
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
    """Show a progress bar with the time left, which disappears at the end.

    Args:
        what: Name of the work.
        total: Amount of the work.
        auto_refresh: Whether a thread redraws the bar; it would disturb a measurement.
        lines: Whether a line every 10 s replaces the bar if standard error is not a terminal.

    Yields:
        A function that takes the completed amount, and another text than `what`.
    """
    percent = TextColumn("{task.percentage:3.0f} %", markup=False)
    about = TextColumn("{task.description}", markup=False)
    columns = (about, BarColumn(), percent, TimeRemainingColumn())
    hidden = out.quiet or not err.is_terminal
    with Progress(
        *columns, console=err, transient=True, disable=hidden, auto_refresh=auto_refresh
    ) as bar:
        task = bar.add_task(what, total=total)
        bar.refresh()
        last_completed, last_line_s = 0, time.monotonic()

        def advance(completed: int, about: str = what) -> None:
            nonlocal last_completed, last_line_s
            bar.update(task, completed=completed, description=about, refresh=not auto_refresh)
            now_s = time.monotonic()
            with_lines = lines and not err.is_terminal and not out.quiet
            is_due = now_s >= last_line_s + _LINE_S and completed > last_completed
            if not with_lines or not is_due:
                return
            per_unit_s = (now_s - last_line_s) / (completed - last_completed)
            left_s = (total - completed) * per_unit_s
            last_completed, last_line_s = completed, now_s
            err.say(f"{about}, about {left_s:.0f} s left")

        yield advance
