"""Terminal output of all commands: two consoles, errors, progress, interruptions."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
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

_FIRST_LINE_S = 2.0  # until the first line on progress
_LINE_S = 10.0  # between two of them


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


at_end: list[Callable[[], None]] = []  # called when a command ends, however it ends

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
    at_end.clear()
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
    finally:
        for tidy_up in at_end:
            tidy_up()


@contextmanager
def progress(what: str, total: int, auto_refresh: bool = True) -> Iterator[Advance]:
    """Show how far the work is: a bar with the time left on a terminal, else lines.

    The bar disappears at the end. If standard error is not a terminal, a line follows after 2 s and
    then every 10 s, whether or not the work has advanced.

    Args:
        what: Name of the work.
        total: Amount of the work.
        auto_refresh: Whether a thread redraws the bar; it would disturb a measurement.

    Yields:
        A function that takes the completed amount, and another text than `what`.
    """
    percent = TextColumn("{task.percentage:3.0f} %", markup=False)
    about = TextColumn("{task.description}", markup=False)
    columns = (about, BarColumn(), percent, TimeRemainingColumn())
    hidden = out.quiet or not err.is_terminal
    with (
        Progress(
            *columns, console=err, transient=True, disable=hidden, auto_refresh=auto_refresh
        ) as bar,
        _progress_lines(what, total) if hidden and not out.quiet else nullcontext() as lines,
    ):
        task = bar.add_task(what, total=total)
        bar.refresh()

        def advance(completed: int, about: str = what) -> None:
            bar.update(task, completed=completed, description=about, refresh=not auto_refresh)
            if lines is not None:
                lines.completed, lines.about = completed, about

        yield advance


@dataclass
class _Lines:
    """How far the work is of which lines tell."""

    about: str
    total: int
    began_s: float
    completed: int = 0

    def line(self) -> str:
        """Return what has been done so far, and how long the rest takes at the same speed."""
        so_far_s = time.monotonic() - self.began_s
        if not self.completed:
            return f"{self.about}: {so_far_s:.0f} s so far"
        left_s = so_far_s * (self.total - self.completed) / self.completed
        share = 100.0 * self.completed / self.total
        return f"{self.about}: {share:.0f} % after {so_far_s:.0f} s, about {left_s:.0f} s left"


@contextmanager
def _progress_lines(what: str, total: int) -> Iterator[_Lines]:
    """Print lines on the progress while the context lasts."""
    lines, done = _Lines(what, total, time.monotonic()), threading.Event()

    def tell() -> None:
        wait_s = _FIRST_LINE_S
        while not done.wait(wait_s):
            err.say(lines.line())
            wait_s = _LINE_S

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield lines
    finally:
        done.set()
        teller.join()
