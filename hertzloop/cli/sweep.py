"""The command `sweep`: simulate many cases of a scene."""

import re
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.many_cases import CONTINUE, cases_are_kept, end_if_failed
from hertzloop.cli.options import (
    JsonOption,
    OverwriteOption,
    SceneArgument,
    SeedOption,
    SetOption,
    options_of,
)
from hertzloop.cli.sweep_results import count_without_metrics, draw_results, print_results
from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.processes.program import LARGEST_PORT
from hertzloop.scene.loading import DEFAULT, parse_setting
from hertzloop.studies.sweep import sweep as sweep_study
from hertzloop.studies.sweep.plan import SweepPlan, plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.result import SweepResult
from hertzloop.warmup import CASES


@options_of(SweepRequest)
def sweep(
    *,
    options: SweepRequest,
    scene: SceneArgument = DEFAULT,
    out_file: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the results to this .parquet or .csv file."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png",
            help="Draw the metrics: a map over two keys of numbers, else over each key.",
        ),
    ] = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    overwrite: OverwriteOption = False,
    json_file: JsonOption = None,
) -> None:
    """Simulate a scene over ranges of its keys.

    The results have a row for every case. A killed sweep goes on with the same command.
    """
    settings = settings or []
    setup = prepare.scene_from(scene, settings, seed)
    target = out_file or Path(f"{setup.scene.name}-sweep.parquet")
    if target.suffix not in (".parquet", ".csv"):
        fail(f"--out = {target}: unknown format. Use a name that ends in .parquet or .csv.")
    if picture is not None:
        outputs.check_picture(picture)
    if options.dask is not None:
        _check_scheduler(options.dask)
    plan = plan_sweep(setup, options)
    _check_plan(plan, settings, seed)
    finished = None if overwrite else sweep_study.finished(plan, target)
    replaced = overwrite or finished is not None
    outputs.check_output(target, replaced, read=outputs.files_of(setup, scene, *settings))
    if picture is not None:
        outputs.check_output(picture, replaced, "--picture")
    outputs.check_writable(target.parent)  # for the journal, even if a file may be replaced
    of_results = (target.with_name(target.name + end) for end in (".json", ".partial"))
    outputs.check_json(json_file, target, picture, *of_results)
    if finished is None:
        prepare.compile_first(setup, works=CASES)
        results = _run(plan, target)
    else:
        results = finished
        err.say(f"{target} has the results of this sweep. --overwrite runs it again.")
    data = print_results(plan, target, results)
    if picture is not None:
        draw_results(picture, plan, results)
    outputs.write_json(json_file, data)
    without_metrics = count_without_metrics(results) == len(plan.cases)
    if without_metrics:
        out.print(f"No case of {len(plan.cases)} has metrics.")
    end_if_failed([row["status"] for row in results.without_result], len(plan.cases))
    if without_metrics:
        raise typer.Exit(1)


def _check_plan(plan: SweepPlan, settings: list[str], seed: int | None) -> None:
    """End the command if --set or --seed gives a key that differs from case to case, or if a law
    of the cases cannot be used."""
    swept = {axis.key: axis.values for axis in plan.design.axes}
    for text in settings:
        if parse_setting(text)[0] in swept:
            fail(f"--set {text}: the sweep varies this key. Remove one of the two.")
    if seed is not None and "run.seed" in swept:
        fail(f"--seed = {seed}: the sweep varies run.seed. Remove one of the two.")
    for law in swept.get("controller.law", ()):
        prepare.check_law(plan.setup.vary({"controller.law": law}))


def _run(plan: SweepPlan, target: Path) -> SweepResult:
    """Run the cases with a progress bar; end the command if they cannot be finished."""
    total = len(plan.cases)
    with (
        cases_are_kept(lambda: f"finished cases are kept. {CONTINUE}", str(target)),
        progress(f"{total} cases", total) as advance,
    ):
        return sweep_study.sweep(
            plan, target, on_progress=advance, on_wait=lambda sentence: err.say(f"{sentence}.")
        )


_SCHEDULER = re.compile(
    r"(?:(?:tcp|tls|ucx|wss?)://)?(?:\[[^\s\]]+\]|[^\s/:\[\]]+):(?P<port>[0-9]{1,9})"
)


def _check_scheduler(address: str) -> None:
    """End the command unless a Dask scheduler can be at an address."""
    need("distributed")
    found = _SCHEDULER.fullmatch(address)
    if not found:
        fail(f"--dask = '{address}': invalid scheduler address. Give it as tcp://host:8786.")
    if not 0 < int(found["port"]) <= LARGEST_PORT:
        fail(f"--dask = '{address}': invalid port. Give a port from 1 to {LARGEST_PORT}.")
