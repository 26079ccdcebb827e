"""The command `budget`."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.budget_text import (
    print_budget,
    print_probability,
    trace_line,
)
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_only_used,
    options_of,
)
from hertzloop.cli.requirements import check_requirements
from hertzloop.cli.terminal import out, progress
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.budget.budget import budget as search_budget
from hertzloop.studies.budget.plan import BudgetPlan, plan_budget
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.budget.result import BudgetResult
from hertzloop.studies.pages.commands import run_command
from hertzloop.warmup import CASES


@options_of(BudgetRequest)
def budget(
    context: typer.Context,
    *,
    options: BudgetRequest,
    scene: SceneArgument = DEFAULT,
    law: Annotated[
        str | None,
        typer.Option(help="Use this law, by name or file; default: the law of the scene."),
    ] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            help="Use the latencies of this CSV file or recording of a paced run, sample by sample."
        ),
    ] = None,
    requirements: Annotated[
        Path | None,
        typer.Option("--check", help="Check the requirements in this file instead of searching."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Find how much latency and how few bits a law tolerates.

    It also searches jitter, noise, sampling period, and the bandwidth and mass of the actuator.

    The same command continues an interrupted search.
    """
    if requirements is not None:
        used = {"requirements", "workers", "json_file"}
        check_only_used(context, used, "with --check, as the file says what is simulated")
    outputs.check_json(json_file)
    if requirements is not None:
        check_requirements(requirements, options.workers, json_file)
        return
    changes = _changes(settings or [], law, trace)
    setup = prepare.scene_from(scene, changes, seed)
    plan = plan_budget(setup, options)
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
