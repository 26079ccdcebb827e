"""What the programs of `benchmarks` and `paper` share: start, options, folder, progress, bars.

A program is a module with a function `main`, run as `python -m benchmarks.NAME`. It prints its
tables, writes CSV files and a picture into a folder, and ends with its conclusion in one sentence.
"""

import importlib
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from hertzloop.cli.options import JsonOption, SceneArgument, SetOption
from hertzloop.cli.outputs import check_folder, check_json, make_folder, write_json
from hertzloop.cli.prepare import compile_first, scene_from
from hertzloop.cli.terminal import err, explained, fail, out
from hertzloop.cli.terminal import progress as terminal_progress
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import load
from hertzloop.studies.words import write_rows
from hertzloop.views.format import Table

__all__ = [
    "BeforeOption", "Item", "JsonOption", "OutDirOption", "QuickOption", "RoundsOption",
    "SceneArgument", "ScenesOption", "SeedOption", "SetOption", "app_of", "bars", "check_folder",
    "check_json", "compile_first", "conclude", "environment_of", "err", "fail", "make_folder",
    "median", "number_table", "out", "progress", "results_in", "scene_from", "share", "start",
    "tracked", "write_json", "write_records", "written",
]  # fmt: skip

Item = TypeVar("Item")
_OF_SCHEME = {"thesis2008": "thesis-aluminium"}  # a scheme that the default scene does not fit

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
BeforeOption = Annotated[
    Path | None,
    typer.Option(
        "--before", help="Measure the checkout in this folder too, in turn.", metavar="PATH",
        exists=True, file_okay=False, resolve_path=True,
    ),
]  # fmt: skip
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


@contextmanager
def results_in(folder: Path | None, program: str, *schemes: str) -> Iterator[Path]:
    """Make the folder for results, compile the kernels of `schemes`, and report a full disk.

    Args:
        folder: the folder that the user named, or None for one named `program`.
        program: name of the program.
        schemes: names of schemes whose kernels are compiled before anything is measured.

    Yields:
        The folder, which exists.
    """
    folder = folder or Path(program)
    need("matplotlib")
    make_folder(folder)
    for scheme in schemes:
        compile_first(load(_OF_SCHEME.get(scheme, DEFAULT), [f"run.scheme={scheme}"]))
    try:
        yield folder
    except OSError as error:
        fail(f"cannot write to the folder {folder}: {error.strerror}", 1)


def environment_of(checkout: Path) -> dict[str, str]:
    """The environment of a process that runs the code of a checkout.

    Args:
        checkout: folder that holds `hertzloop`.

    Returns:
        This environment, with another PYTHONPATH.
    """
    return {**os.environ, "PYTHONPATH": str(checkout)}


def cost_of(
    words: Sequence[str], checkout: Path, folder: Path, more: Mapping[str, str] | None = None
) -> tuple[float, float]:
    """Run a command that uses the code of a checkout, and measure it.

    Args:
        words: the command.
        checkout: folder that holds `hertzloop`.
        folder: working folder; the output goes to `said.txt` there.
        more: further variables of its environment.

    Returns:
        Wall time, and processor time of the command and the children that it waited for, s.

    Raises:
        subprocess.CalledProcessError: the command failed.
    """
    environment = environment_of(checkout) | dict(more or {})
    with (folder / "said.txt").open("w") as said:
        used, began = os.times(), time.perf_counter()
        subprocess.run(
            words, cwd=folder, env=environment, stdout=said, stderr=subprocess.STDOUT, check=True
        )
        wall_s, now = time.perf_counter() - began, os.times()
    cpu_s = now.children_user + now.children_system - used.children_user - used.children_system
    return wall_s, cpu_s


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


def number_table(
    title: str, headings: Iterable[str], rows: Iterable[Iterable[str]], text: int = 0
) -> Table:
    """A table of numbers.

    Args:
        title: title of the table.
        headings: one for each column.
        rows: cells, ready as text.
        text: number of columns at the left that hold text.

    Returns:
        The table, to print.
    """
    table = Table(title=title)
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="left" if i < text else "right")
    for row in rows:
        table.add_row(*row)
    return table


def bars(
    path: Path, title: str, axis: str, values: Sequence[tuple[str, float]], log: bool = False
) -> Path:
    """Draw a plain chart of horizontal bars.

    Args:
        path: picture to write (PNG).
        title: title of the chart.
        axis: quantity and unit of the values.
        values: label and value of each bar, the first one on top; a bar without a finite value is
            left empty.
        log: whether the axis is logarithmic.

    Returns:
        The path.
    """
    from hertzloop.studies import pictures

    metric, [[axes]] = pictures.sheet(1, 1, 8.0, 0.32 * len(values) + 1.4)
    places = range(len(values))
    sizes = [value if math.isfinite(value) else 0.0 for _, value in values]
    drawn = axes.barh(places, sizes, color=pictures.COLOURS[0])
    axes.bar_label(drawn, [f"{value:.3g}" for _, value in values], padding=4, fontsize=8)
    axes.set_yticks(places, [label for label, _ in values], fontsize=8)
    axes.invert_yaxis()
    if log:
        axes.set_xscale("log")
    axes.grid(axis="y", visible=False)
    axes.margins(x=0.15)
    axes.set(title=title, xlabel=axis)
    return pictures.save(metric, path)


def median(values: Iterable[float]) -> float:
    """The median of the finite values, NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return statistics.median(finite) if finite else math.nan


def share(met: int, of: int) -> str:
    """A share in per cent with its counts, as text: "95 % (38 of 40)"."""
    return f"{100.0 * met / of:.0f} % ({met} of {of})" if of else "none (0 of 0)"


def written(folder: Path, *names: str) -> None:
    """Print which files were written into a folder."""
    *others, last = names
    listed = f"{', '.join(others)} and {last}" if others else last
    out.print(f"written: {folder}/{listed}", soft_wrap=True)


def conclude(sentence: str) -> None:
    """Print the conclusion, as the last line of a program."""
    out.print(sentence, soft_wrap=True)
    sys.stdout.flush()


def write_records(path: Path, records: Sequence[Any]) -> None:
    """Instances of one dataclass, at least one, a line each; the fields are the columns."""
    names = [field.name for field in fields(records[0])]
    write_rows(path, names, (astuple(record) for record in records))
