"""The command `budget`."""

import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.budget_text import (
    effect_lines,
    print_budget,
    print_probability,
    probability_line,
    trace_line,
)
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.requirements import check_requirements
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.cli.unused_options import check_only_used
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.budget.budget import budget as search_budget
from hertzloop.studies.budget.plan import BudgetPlan, plan_budget
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.budget.result import BudgetResult
from hertzloop.studies.pages.commands import run_command
from hertzloop.warmup import CASES

_UNCERTAIN = "Probability of the goal"  # heading of options

GoalOption = Annotated[
    list[str] | None,
    typer.Option(
        "--goal",
        help="Require this at every touch phase, for example 'plate_energy_db <= -3'; repeatable; "
        "default: plate_energy_db <= -0.1.",
    ),
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Search coarsely, with a thin plate as the real one.")
]
OnlyOption = Annotated[
    list[str] | None,
    typer.Option(help="Search this quantity, for example latency_us; repeatable."),
]
RealPlantOption = Annotated[
    bool, typer.Option("--real-plant/--no-real-plant", help="Search in the real plant too.")
]
BudgetSpanOption = Annotated[
    Literal["impact", "run", "both"],
    typer.Option(help="Take metrics of the first impact, or of the whole run, or of each."),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Use this many processes; default: one for each core.")
]
WithinOption = Annotated[
    float,
    typer.Option(
        min=1e-4,
        max=0.5,
        help="Stop drawing at this half width of the interval.",
        rich_help_panel=_UNCERTAIN,
    ),
]
MostCasesOption = Annotated[
    int,
    typer.Option(
        min=16,
        max=1_000_000,
        help="Stop drawing after this many cases.",
        rich_help_panel=_UNCERTAIN,
    ),
]
SobolOption = Annotated[
    int,
    typer.Option(
        min=0,
        help="Base points for Sobol indices, a power of 2; 0 for none.",
        rich_help_panel=_UNCERTAIN,
    ),
]
LawOption = Annotated[
    str | None, typer.Option(help="Use this law, by name or file; default: the law of the scene.")
]
TraceOption = Annotated[
    Path | None,
    typer.Option(
        help="Use the latencies of this CSV file or recording of a paced run, sample by sample."
    ),
]
UncertainOption = Annotated[
    Path | None,
    typer.Option(
        "--uncertain",
        help="Compute the probability of the goal for the distributions in this TOML file, or in "
        "the tables \\[uncertain] and \\[fit] of this scene.",
        rich_help_panel=_UNCERTAIN,
    ),
]
CheckOption = Annotated[
    Path | None,
    typer.Option("--check", help="Check the requirements in this file instead of searching."),
]
JunitOption = Annotated[
    Path | None,
    typer.Option("--junit", help="Write the results of --check to this file as JUnit XML."),
]
OutDirOption = Annotated[
    Path | None, typer.Option("--out-dir", "-o", help="Folder for the results as a page.")
]


@dataclass(frozen=True)
class BudgetArguments:
    """What `hertzloop budget` was called with, beside its request.

    Attributes:
        scene: Name of the scene.
        settings: Changes of its keys, those of --law and --trace included.
        folder: Folder for a page, if one is asked for.
    """

    scene: str
    settings: list[str]
    folder: Path | None


def budget(
    context: typer.Context,
    goals: GoalOption = None,
    quick: QuickOption = False,
    only: OnlyOption = None,
    with_real: RealPlantOption = True,
    span: BudgetSpanOption = "impact",
    workers: WorkersOption = None,
    within: WithinOption = BudgetRequest.within,
    most_cases: MostCasesOption = BudgetRequest.most_cases,
    sobol: SobolOption = 0,
    scene: options.SceneArgument = DEFAULT,
    law: LawOption = None,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    trace: TraceOption = None,
    uncertain_file: UncertainOption = None,
    requirements: CheckOption = None,
    junit_file: JunitOption = None,
    folder: OutDirOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Find how much latency and how few bits a law tolerates.

    It also searches jitter, noise, sampling period, and the bandwidth and mass of the actuator.

    The same command continues an interrupted search.
    """
    if requirements is not None:
        used = {"requirements", "workers", "junit_file", "json_file"}
        check_only_used(context, used, "with --check, as the file says what is simulated")
    request = BudgetRequest(
        goals=goals or (),
        quick=quick,
        only=only or (),
        with_real=with_real,
        with_map=folder is not None,
        span=span,
        workers=workers,
        uncertain=uncertain_file,
        within=within,
        most_cases=most_cases,
        sobol=sobol,
    )
    outputs.check_json(json_file)
    outputs.check_folder(junit_file)
    if requirements is not None:
        check_requirements(requirements, workers, junit_file, json_file)
        return
    if junit_file is not None:
        fail("--junit needs --check. Name a file of requirements")
    arguments = BudgetArguments(scene, _changes(settings or [], law, trace), folder)
    setup = prepare.scene_from(scene, arguments.settings, seed)
    plan = plan_budget(setup, request)
    if folder is not None:
        need("matplotlib", "jinja2")
    outputs.make_folder(folder or Path())  # for unfinished work, too
    prepare.compile_first(setup, works=CASES)
    began_s = time.perf_counter()
    with (
        resumable(folder or Path(), "budget", plan.identity) as finished,
        progress("budget", 1000) as advance,
    ):
        result = search_budget(plan, finished, lambda share: advance(round(1000 * share)))
    data = _print_result(arguments, plan, result)
    out.print(f"{result.all_cases} cases in {time.perf_counter() - began_s:z.1f} s")
    if folder is not None:
        _write_page(folder, arguments, plan, result)
    outputs.write_json(json_file, data)
    end_if_failed(result.failed, result.all_cases)


def _changes(settings: list[str], law: str | None, trace: Path | None) -> list[str]:
    """Return all changes of scene keys: those of --set, --law and --trace."""
    changes = list(settings)
    if law is not None:
        changes.append(f"controller.law={law}")
    if trace is not None:
        changes += ["controller.latency_us=0", f"controller.latency_trace={trace}"]
    return changes


def _print_result(
    arguments: BudgetArguments, plan: BudgetPlan, result: BudgetResult
) -> dict[str, Any]:
    """Print what was found, and return it as plain data."""
    latencies_us = plan.setup.scene.controller.latency_trace
    if latencies_us:
        out.print(trace_line(latencies_us))
    print_budget(result)
    data = result.as_data()
    likely = result.probability
    if likely:
        command = run_command(arguments.scene, likely.worst, arguments.settings, plan.setup.seed)
        print_probability(likely, result.sensitivities, command)
        data["probability"]["worst_command"] = command
    return data


def _write_page(
    folder: Path, arguments: BudgetArguments, plan: BudgetPlan, result: BudgetResult
) -> None:
    """Write what was found as a page, with the command that finds it again."""
    from hertzloop.studies.budget.page import budget_page  # of an extra

    lines = effect_lines(result)
    if result.probability:
        lines.append(probability_line(result.probability))
    page = folder / "budget.html"
    command = _command(folder, arguments, plan)
    atomic_write(page, budget_page(plan.setup, result, lines, command).html())
    out.say(f"written: {page}")


def _command(folder: Path, arguments: BudgetArguments, plan: BudgetPlan) -> str:
    """Return the command that finds the same again."""
    request, usual = plan.request, BudgetRequest()
    words = ["hertzloop", "budget", arguments.scene, "--seed", str(plan.setup.seed)]
    several = {"--set": arguments.settings, "--goal": plan.goals, "--only": request.only}
    words += [str(word) for name, values in several.items() for v in values for word in (name, v)]
    flags = {
        "--quick": request.quick,
        "--no-real-plant": not request.with_real,
    }
    words += [name for name, given in flags.items() if given]
    values = {
        "--span": (request.span, usual.span),
        "--uncertain": (request.uncertain, usual.uncertain),
        "--within": (request.within, usual.within),
        "--most-cases": (request.most_cases, usual.most_cases),
        "--sobol": (request.sobol, usual.sobol),
    }
    for name, (value, other) in values.items():
        words += [] if value == other else [name, str(value)]
    return shlex.join([*words, "--out-dir", str(folder)])
