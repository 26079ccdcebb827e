"""The command `tune`."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.options import JsonOption, SeedOption, SetOption, options_of
from hertzloop.cli.terminal import fail, progress
from hertzloop.cli.tune_results import TuneArguments, as_data, print_result, write_result
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.cases.finished_cases import FinishedCases
from hertzloop.studies.tune.plan import TunePlan, plan_tune
from hertzloop.studies.tune.request import TuneRequest
from hertzloop.studies.tune.result import TuneResult
from hertzloop.warmup import CASES


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
    prepare.compile_first(*bases, works=CASES)
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
