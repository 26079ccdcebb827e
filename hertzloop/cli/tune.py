"""The command `tune`."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.terminal import fail
from hertzloop.cli.tune_results import as_data, print_result, write_result
from hertzloop.cli.tune_search import TuneArguments, checked_study, search_settings
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.requests import TuneRequest
from hertzloop.warmup import CASES

MinimiseOption = Annotated[
    list[str],
    typer.Option("--minimise", help="Minimise this metric; repeat for a Pareto front."),
]
GenerationsOption = Annotated[
    int, typer.Option(min=1, max=10_000, help="Stop after this many generations.")
]
PopulationOption = Annotated[
    int, typer.Option(min=4, max=1000, help="Evaluate this many settings in a generation.")
]
PhasesOption = Annotated[
    int, typer.Option(min=1, max=100, help="Average over this many touch phases.")
]
RequireStableOption = Annotated[
    bool,
    typer.Option(
        "--require-stable",
        help="Refuse settings whose linear loop is unstable in flight, however short the run.",
    ),
]
ScenesArgument = Annotated[
    list[str] | None,
    typer.Argument(help="Names of scenes or .toml files; the worst result counts."),
]
LawOption = Annotated[
    list[str] | None,
    typer.Option("--law", help="Tune this law, or all; repeatable; default: the law of the scene."),
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        help="Search a scene key over key=low:high or key=a,b,c; default: the ranges of the law.",
    ),
]
OverOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Require robustness over these values, for example sphere.radius_m=0.002,0.004."
    ),
]
AtMostOption = Annotated[
    list[str] | None, typer.Option(help="Limit a metric, for example rebound_percent=120.")
]
OutDirOption = Annotated[
    Path | None,
    typer.Option(
        "--out-dir", "-o", metavar="DIR", help="Write chart and settings into this folder."
    ),
]

_MINIMISED = list(TuneRequest.objectives)


def tune(
    objectives: MinimiseOption = _MINIMISED,
    span: options.SpanOption = "impact",
    generations: GenerationsOption = TuneRequest.generations,
    population: PopulationOption = TuneRequest.population,
    phases: PhasesOption = TuneRequest.phases,
    require_stable: RequireStableOption = False,
    scenes: ScenesArgument = None,
    laws: LawOption = None,
    ranges: VaryOption = None,
    over: OverOption = None,
    at_most: AtMostOption = None,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    folder: OutDirOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Search for the law and the parameters with the best metrics in a scene.

    The search respects the scene's latency, bits and force limit. A killed search goes on with the
    same command.
    """
    search = TuneRequest(
        objectives=tuple(objectives),
        span=span,
        generations=generations,
        population=population,
        phases=phases,
        seed=1 if seed is None else seed,
        require_stable=require_stable,
    )
    arguments = TuneArguments(
        search,
        scenes or [DEFAULT],
        laws,
        ranges or [],
        over or [],
        at_most or [],
        settings or [],
        seed,
    )
    need("matplotlib", "pymoo")
    outputs.check_json(json_file)
    study = checked_study(arguments)
    outputs.make_folder(folder or Path())  # for what is unfinished, too
    prepare.compile_first(*study.bases, works=CASES)
    with resumable(folder or Path(), study.name, study.header) as finished:
        result = search_settings(study, finished)
        if result.best:
            print_result(arguments, study, result)
        if result.best and folder is not None:
            write_result(folder, arguments, study, result)
    if not result.best:
        end_if_failed(result.failed, result.cases)
        fail(
            "no setting has all metrics within --at-most, or meets --require-stable: the loop may "
            "be unstable, or nothing may rebound. Try --span run or other ranges.",
            1,
        )
    outputs.write_json(json_file, as_data(result))
    end_if_failed(result.failed, result.cases)
