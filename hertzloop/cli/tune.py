"""The command `tune`, and what it prints and writes."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.options import JsonOption, SeedOption, SetOption, options_of
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.journal import FinishedCases
from hertzloop.studies.margin.sentences import unstable_line
from hertzloop.studies.pages.words import run_command, write_rows
from hertzloop.studies.tune.plan import TunePlan, plan_tune
from hertzloop.studies.tune.request import TuneRequest
from hertzloop.studies.tune.result import Candidate, TuneResult
from hertzloop.views.format import Table, unwrapped

_MOST_ROWS = 15
_PARTS = ("mean", "least", "most")  # of a spread over touch phases


@options_of(TuneRequest, but=["seed"])
def tune(
    *,
    options: TuneRequest,
    scenes: Annotated[
        list[str] | None,
        typer.Argument(help="Names of scenes or .toml files; the worst result counts."),
    ] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out-dir",
            "-o",
            metavar="DIR",
            help="Write settings, chart and scenes into this folder.",
        ),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Search for the law and the parameters with the best metrics in a scene.

    The search respects the scene's latency, bits and force limit. A killed search goes on with the
    same command.
    """
    if seed is not None:
        options = options.replaced(seed=seed)
    arguments = TuneArguments(scenes or [DEFAULT], settings or [], seed)
    need("matplotlib", "pymoo")
    outputs.check_json(json_file)
    bases = [prepare.scene_from(name, arguments.settings, seed) for name in arguments.scenes]
    plan = plan_tune(bases, options, prepare.check_law)
    outputs.make_folder(folder or Path())  # for what is unfinished, too
    prepare.compile_first(*bases)
    with resumable(folder or Path(), arguments.file_name(plan), plan.identity) as finished:
        result = _search(plan, finished)
        if result.front:
            print_result(arguments, plan, result)
        if result.front and folder is not None:
            write_result(folder, arguments, plan, result)
    if not result.front:
        end_if_failed(result.failed, result.cases)
        fail(
            "no setting has all metrics within --at-most, or meets --require-stable: the loop may "
            "be unstable, or nothing may rebound. Try --span run or other ranges.",
            1,
        )
    outputs.write_json(json_file, as_data(result))
    end_if_failed(result.failed, result.cases)


def _search(plan: TunePlan, finished: FinishedCases) -> TuneResult:
    """Search, with a progress bar; end the command with exit code 1 if a scene fails."""
    from hertzloop.studies.tune.tune import tune as search_settings  # of an extra

    generations = plan.request.generations * len(plan.axes)
    try:
        with progress("tuning", generations) as advance:
            return search_settings(plan, finished, advance)
    except SceneError as error:
        fail(str(error), 1)


@dataclass(frozen=True)
class TuneArguments:
    """What `hertzloop tune` was called with, beside its request.

    Attributes:
        scenes: Names of the scenes.
        settings: Changes of scene keys.
        seed: Random seed; None: that of each scene.
    """

    scenes: list[str]
    settings: list[str]
    seed: int | None

    def file_name(self, plan: TunePlan) -> str:
        """Return the name of the files with results."""
        return "tune-" + "-".join(base.scene.name for base in plan.bases)


def print_result(arguments: TuneArguments, plan: TunePlan, result: TuneResult) -> None:
    """Print the settings found, the verdict, and the commands that run the best one."""
    out.print(_table(result))
    out.say(result.verdict)
    best, unstable = result.best, sum(one.unstable_loop is not None for one in result.front)
    if unstable:
        text = f" in {unstable} of {len(result.front)} settings. --require-stable refuses these."
        out.say(unwrapped(("Linear loop unstable", "bold red"), text))
    if best.unstable_loop is not None:
        out.say(f"The loop of the best setting {unstable_line(best.unstable_loop)}")
    out.print(f"Repetition of the best setting ({best.words()}):")
    for setup, name in zip(_scenes_with(best, plan), arguments.scenes, strict=True):
        out.say(f"  {_run_command(best, setup, name, arguments)}")


def as_data(result: TuneResult) -> dict[str, Any]:
    """Return the settings found as plain data."""
    return {
        "front": [asdict(candidate) for candidate in result.front],
        "published": asdict(result.published),
        "verdict": [result.verdict],
        "cases": result.cases,
        "ran": result.ran,
        "failed": len(result.failed),
    }


def write_result(
    folder: Path, arguments: TuneArguments, plan: TunePlan, result: TuneResult
) -> None:
    """Write the settings as CSV, the picture, and each scene with the best setting.

    Raises:
        NotWritten: A file cannot be written.
    """
    from hertzloop.studies.pages import pictures  # of an extra, as the next
    from hertzloop.studies.tune.chart import front_sheet

    name, metrics = arguments.file_name(plan), result.minimise
    keys = sorted({key for candidate in result.front for key in candidate.values})
    headings = [*metrics, *(f"{o}_{part}" for o in metrics for part in _PARTS), *keys]
    rows = (
        [
            *candidate.metrics.values(),
            *(getattr(candidate.spreads[o], part) for o in metrics for part in _PARTS),
            *(candidate.values.get(key, "") for key in keys),
        ]
        for candidate in result.front
    )
    write_rows(folder / f"{name}.csv", headings, rows)
    title = ", ".join(base.scene.name for base in plan.bases)
    pictures.save(front_sheet(title, result), folder / f"{name}.png")
    best_scenes = _scenes_with(result.best, plan)
    for setup in best_scenes:
        atomic_write(folder / f"tuned-{setup.scene.name}.toml", to_toml(setup.scene))
    out.say(
        f"written: {folder}/{name}.csv and .png; with the best setting: "
        + ", ".join(f"{folder}/tuned-{setup.scene.name}.toml" for setup in best_scenes)
    )


def _scenes_with(candidate: Candidate, plan: TunePlan) -> list[Setup]:
    """Return the scenes with a setting."""
    return [base.vary(candidate.values) for base in plan.bases]


def _table(result: TuneResult) -> Table:
    """Return the table of settings, at most some of them, with the published one last."""
    metrics, best = result.minimise, result.front
    every = max(1, -(-len(best) // _MOST_ROWS))
    shown = best[::every]
    right = [*metrics, f"{metrics[0]} over touch phases"]
    table = Table(right=right, title=_title(len(shown), len(best), metrics))
    table.add_column("law and parameters")
    for candidate in [*shown, result.published]:
        note = " (published)" if candidate is result.published else ""
        table.add_row(
            *(f"{value:z.3f}" for value in candidate.metrics.values()),
            str(candidate.spreads[metrics[0]]),
            candidate.words() + note,
        )
    return table


def _title(shown: int, found: int, metrics: Sequence[str]) -> str:
    """Return how many settings a table shows, and in which order."""
    if found == 1:
        return "1 Pareto-optimal setting"
    count = f"{shown} of {found}" if shown < found else str(found)
    order = f"by {metrics[0]}"
    if len(metrics) > 1:
        order = f"{order}, those with no more {metrics[1]} than the published setting first"
    return f"{count} Pareto-optimal settings, {order}"


def _run_command(candidate: Candidate, setup: Setup, name: str, arguments: TuneArguments) -> str:
    """Return the command that runs a scene with a setting.

    Args:
        candidate: The setting.
        setup: The scene with the setting.
        name: Name of the scene, as the user wrote it.
        arguments: Changes of keys and the seed.
    """
    known = {f"controller.{key}" for key, _ in setup.scene.controller}
    given = [text.strip() for text in arguments.settings]
    # A key of the scene's own law may be unknown to the law that was found.
    kept = [
        text
        for text in given
        if text.partition("=")[0].strip() in known or not text.startswith("controller.")
    ]
    return run_command(name, candidate.values, kept, arguments.seed)
