"""The command `budget`."""

import time
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.budget_text import (
    print_budget,
    print_probability,
    trace_line,
)
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.requirements import check_requirements
from hertzloop.cli.terminal import out, progress
from hertzloop.cli.unused_options import check_only_used
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
    scene: options.SceneArgument = DEFAULT,
    law: LawOption = None,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    trace: TraceOption = None,
    uncertain_file: UncertainOption = None,
    requirements: CheckOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Find how much latency and how few bits a law tolerates.

    It also searches jitter, noise, sampling period, and the bandwidth and mass of the actuator.

    The same command continues an interrupted search.
    """
    if requirements is not None:
        used = {"requirements", "workers", "json_file"}
        check_only_used(context, used, "with --check, as the file says what is simulated")
    request = BudgetRequest(
        goals=goals or (),
        quick=quick,
        only=only or (),
        with_real=with_real,
        span=span,
        workers=workers,
        uncertain=uncertain_file,
        within=within,
        most_cases=most_cases,
    )
    outputs.check_json(json_file)
    if requirements is not None:
        check_requirements(requirements, workers, json_file)
        return
    changes = _changes(settings or [], law, trace)
    setup = prepare.scene_from(scene, changes, seed)
    plan = plan_budget(setup, request)
    outputs.check_writable(Path())  # for unfinished work
    prepare.compile_first(setup, works=CASES)
    began_s = time.perf_counter()
    with (
        resumable(Path(), "budget", plan.identity) as finished,
        progress("budget", 1000) as advance,
    ):
        result = search_budget(plan, finished, lambda share: advance(round(1000 * share)))
    data = _print_result(scene, changes, plan, result)
    out.print(f"{result.all_cases} cases in {time.perf_counter() - began_s:z.1f} s")
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
    scene: str, changes: list[str], plan: BudgetPlan, result: BudgetResult
) -> dict[str, Any]:
    """Print what was found, and return it as plain data.

    Args:
        scene: Name of the scene.
        changes: All changes of its keys.
        plan: What was searched.
        result: What was found.
    """
    latencies_us = plan.setup.scene.controller.latency_trace
    if latencies_us:
        out.print(trace_line(latencies_us))
    print_budget(result)
    data = result.as_data()
    likely = result.probability
    if likely:
        command = run_command(scene, likely.worst, changes, plan.setup.run.seed)
        print_probability(likely, command)
        data["probability"]["worst_command"] = command
    return data
