"""The command `sweep`: simulate many cases of a scene."""

import re
from pathlib import Path
from typing import Annotated, Literal

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.many_cases import CONTINUE, cases_are_kept, end_if_failed
from hertzloop.cli.sweep_results import (
    SweepArguments,
    SweepStudy,
    count_without_metrics,
    draw_results,
    print_results,
)
from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.processes.program import LARGEST_PORT
from hertzloop.scene.loading import DEFAULT, parse_setting
from hertzloop.studies.sweep import sweep as sweep_study
from hertzloop.studies.sweep.plan import SweepPlan, plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.result import SweepResult
from hertzloop.warmup import CASES

OverOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Vary a scene key: key=low:high:step, key=a,b,c, or key=low:high for spread points; "
        "repeatable."
    ),
]
DesignOption = Annotated[
    Literal["grid", "lhs", "sobol"],
    typer.Option(help="Run all combinations, or points spread over the ranges."),
]
CasesOption = Annotated[
    int | None,
    typer.Option(min=1, help="Run this many spread points; default: 256."),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Use this many processes; default: one for each core.")
]
PhasesOption = Annotated[
    int | None,
    typer.Option(
        min=2,
        max=1000,
        help="Run every case at this many touch phases; print mean and range.",
    ),
]
UncertainOption = Annotated[
    Path | None,
    typer.Option(
        help="Run every case with --cases draws from the distributions in this TOML file, or "
        "in the tables \\[uncertain] and \\[fit] of this scene."
    ),
]
DaskOption = Annotated[
    str | None,
    typer.Option(help="Use the Dask scheduler at this address, for example tcp://host:8786."),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Write the results to this .parquet or .csv file."),
]

PictureOption = Annotated[
    Path | None,
    typer.Option(
        metavar="F.png",
        help="Draw the metrics: a map over two keys of numbers, else over each key.",
    ),
]


def sweep(
    over: OverOption = None,
    design: DesignOption = "grid",
    cases: CasesOption = None,
    span: options.SpanOption = "impact",
    workers: WorkersOption = None,
    phases: PhasesOption = None,
    uncertain: UncertainOption = None,
    dask: DaskOption = None,
    scene: options.SceneArgument = DEFAULT,
    out_file: OutOption = None,
    picture: PictureOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
    json_file: options.JsonOption = None,
) -> None:
    """Simulate a scene over ranges of its keys.

    The results have a row for every case. A killed sweep goes on with the same command.
    """
    request = SweepRequest(over or (), design, cases, span, workers, phases, uncertain, dask)
    arguments = SweepArguments(
        request, scene, settings or [], seed, out_file, picture, overwrite, json_file
    )
    study = _checked(arguments)
    if study.finished is None:
        prepare.compile_first(study.plan.setup, works=CASES)
        results = _run(study)
    else:
        results = study.finished
        err.say(f"{study.results_file} has the results of this sweep. --overwrite runs it again.")
    data = print_results(study, results)
    if picture is not None:
        draw_results(picture, study, results)
    outputs.write_json(json_file, data)
    without_metrics = count_without_metrics(results) == study.total
    if without_metrics:
        out.print(f"No case of {study.total} has metrics.")
    end_if_failed([row["status"] for row in results.without_result], study.total)
    if without_metrics:
        raise typer.Exit(1)


def _checked(arguments: SweepArguments) -> SweepStudy:
    """Return the sweep to run; end the command if it cannot be run or written."""
    request, settings = arguments.request, arguments.settings
    setup = prepare.scene_from(arguments.scene, settings, arguments.seed)
    target = arguments.out_file or Path(f"{setup.scene.name}-sweep.parquet")
    if target.suffix not in (".parquet", ".csv"):
        fail(f"--out = {target}: unknown format. Use a name that ends in .parquet or .csv.")
    if arguments.picture is not None:
        outputs.check_picture(arguments.picture)
    if request.dask is not None:
        _check_scheduler(request.dask)
    plan = plan_sweep(setup, request)
    _check_not_swept(arguments, plan)
    for axis in plan.design.axes:
        for law in axis.values if axis.key == "controller.law" else ():
            prepare.check_law(setup.vary({"controller.law": law}))
    overwrite = arguments.overwrite
    finished = None if overwrite else sweep_study.finished(plan, target)
    outputs.check_output(
        target,
        overwrite or finished is not None,
        read=outputs.files_of(setup, arguments.scene, *settings),
    )
    if arguments.picture is not None:
        outputs.check_output(arguments.picture, overwrite or finished is not None, "--picture")
    outputs.check_writable(target.parent)  # for the journal, even if a file may be replaced
    of_results = (target.with_name(target.name + end) for end in (".json", ".partial"))
    study = SweepStudy(plan, target, finished)
    outputs.check_json(arguments.json_file, target, arguments.picture, *of_results)
    return study


def _check_not_swept(arguments: SweepArguments, plan: SweepPlan) -> None:
    """End the command if --set or --seed gives a key that differs from case to case."""
    swept = {axis.key for axis in plan.design.axes}
    for text in arguments.settings:
        if parse_setting(text)[0] in swept:
            fail(f"--set {text}: the sweep varies this key. Remove one of the two.")
    if arguments.seed is not None and "run.seed" in swept:
        fail(f"--seed = {arguments.seed}: the sweep varies run.seed. Remove one of the two.")


def _run(study: SweepStudy) -> SweepResult:
    """Run the cases with a progress bar; end the command if they cannot be finished."""
    total, target = study.total, study.results_file
    with (
        cases_are_kept(lambda: f"finished cases are kept. {CONTINUE}", str(target)),
        progress(f"{total} cases", total) as advance,
    ):
        return sweep_study.sweep(
            study.plan,
            target,
            on_progress=advance,
            on_wait=lambda sentence: err.say(f"{sentence}."),
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
