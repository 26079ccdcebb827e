"""The command `tune`."""

import math
import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.many_cases import end_if_failed, resumable
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
        "--out-dir",
        "-o",
        metavar="DIR",
        help="Write settings, chart and scenes into this folder.",
    ),
]

_MINIMISED = list(TuneRequest.minimise)


def tune(
    minimise: MinimiseOption = _MINIMISED,
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
    request = TuneRequest(
        laws=laws or (),
        vary=ranges or (),
        over=over or (),
        minimise=tuple(minimise),
        at_most=_limits(at_most or []),
        span=span,
        generations=generations,
        population=population,
        phases=phases,
        seed=1 if seed is None else seed,
        require_stable=require_stable,
    )
    arguments = TuneArguments(scenes or [DEFAULT], settings or [], seed)
    need("matplotlib", "pymoo")
    outputs.check_json(json_file)
    bases = [prepare.scene_from(name, arguments.settings, seed) for name in arguments.scenes]
    plan = plan_tune(bases, request, prepare.check_law)
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


def _limits(texts: list[str]) -> dict[str, float]:
    """Return the limits of --at-most by metric; end the command for one that is no number."""
    limits = {}
    for text in texts:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*(\S+)\s*", text)
        with suppress(ValueError):
            if match and math.isfinite(float(match[2])):
                limits[match[1]] = float(match[2])
                continue
        fail(
            f"--at-most = '{text}': invalid limit. Write metric=number, as in rebound_percent=120."
        )
    return limits


def _search(plan: TunePlan, finished: FinishedCases) -> TuneResult:
    """Search, with a progress bar; end the command with exit code 1 if a scene fails."""
    from hertzloop.studies.tune.tune import tune as search_settings  # of an extra

    generations = plan.request.generations * len(plan.axes)
    try:
        with progress("tuning", generations) as advance:
            return search_settings(plan, finished, advance)
    except SceneError as error:
        fail(str(error), 1)
