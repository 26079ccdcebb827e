"""What the programs of `benchmarks` and `paper` share: their start, options and progress bars.

A program is a module with a function `main`, run as `python -m benchmarks.NAME`. It prints its
tables, writes files into a folder (`benchmarks.results`), and ends with its conclusion.
"""

import importlib
import math
import statistics
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from hertzloop.cli.terminal import explained
from hertzloop.cli.terminal import progress as terminal_progress

Item = TypeVar("Item")

# A thread that redraws the bar would disturb the measurements.
progress = partial(terminal_progress, auto_refresh=False)

OutDirOption = Annotated[
    Path | None,
    typer.Option(
        "--out-dir",
        "-o",
        help="Write CSV files and pictures into this folder, by default one named after the "
        "program.",
        show_default=False,
    ),
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Measure less, for a first look or a test.")
]
RoundsOption = Annotated[
    int, typer.Option(min=1, help="Measure every case in this many rounds (1 with --quick).")
]
ScenesOption = Annotated[
    int, typer.Option(min=1, help="Draw this many random scenes (4 with --quick).")
]
SeedOption = Annotated[int, typer.Option(help="Draw the random scenes by this seed.")]


class _Program(TyperCommand):
    """A command that ends in one sentence when it is interrupted or lacks a package."""

    # pyrefly: ignore[bad-override]
    def invoke(self, *args: Any) -> Any:
        """Run the program."""
        with explained():
            return super().invoke(*args)


def app_of(main: Callable[..., None]) -> typer.Typer:
    """The command line of a program.

    Args:
        main: function with typer's annotations; its docstring is the help text.

    Returns:
        An application with one command.
    """
    app = typer.Typer(
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        add_completion=False,
        rich_markup_mode=None,
    )
    app.command(cls=_Program)(main)
    return app


def start(module: str) -> None:
    """Run a program from its module's `if __name__ == "__main__"`.

    The module is imported again under its own name, so that worker processes and pickled objects
    find its classes there and not in `__main__`.

    Args:
        module: full name of the module, such as "benchmarks.cases".
    """
    from hertzloop.__main__ import collect_rarely, command_line

    collect_rarely()  # as `hertzloop` does, whose speed is measured
    with command_line():
        from hertzloop.cli.app import main as run

        command = typer.main.get_command(app_of(importlib.import_module(module).main))
        run(lambda: command(prog_name=f"python -m {module}"))


def tracked(what: str, items: Iterable[Item]) -> Iterator[Item]:
    """Iterate over items with a progress bar.

    Args:
        what: name of the work.
        items: any number of items.

    Yields:
        The items.
    """
    known = list(items)
    with progress(what, len(known)) as advance:
        for i, item in enumerate(known, 1):
            yield item
            advance(i)


def median(values: Iterable[float]) -> float:
    """The median of the finite values, NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return statistics.median(finite) if finite else math.nan


def share(met: int, of: int) -> str:
    """A share in per cent with its counts, as text: "95 % (38 of 40)"."""
    return f"{100.0 * met / of:.0f} % ({met} of {of})" if of else "none (0 of 0)"
