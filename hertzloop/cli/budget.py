"""The command `budget`, its sentences and tables, and the requirements of `budget --check`."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.many_cases import end_if_failed, resumable
from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_only_used,
    options_of,
)
from hertzloop.cli.terminal import if_interrupted, out, progress
from hertzloop.common import readable
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.budget.budget import budget as search_budget
from hertzloop.studies.budget.limits import LEAST, Boundary
from hertzloop.studies.budget.plan import BudgetPlan, plan_budget
from hertzloop.studies.budget.probability import Probability
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.budget.requirements.check import check
from hertzloop.studies.budget.requirements.requirement import read_requirements
from hertzloop.studies.budget.result import BudgetResult, InPlant
from hertzloop.studies.budget.stability import instability
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.margin.sentences import margin_lines
from hertzloop.studies.pages.words import run_command
from hertzloop.views.format import Table, unwrapped
from hertzloop.views.verdict import spans_differ


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
    prepare.compile_first(setup)
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


def _plants(found: BudgetResult) -> list[tuple[str, InPlant]]:
    """Return the plants that were searched, by what sentences call them."""
    real = [("the real plant", found.real)] if found.real else []
    if not found.other:
        return [("the scene", found.ideal), *real]
    return [("the first impact", found.ideal), ("the whole run", found.other), *real]


def effect_lines(found: BudgetResult) -> list[str]:
    """Return sentences on the goal, and on what the law does in each plant."""
    lines = [verdict_line(found)]
    for name, plant in _plants(found):
        energy = plant.nominal.over_phases["plate_energy_db"]
        words = "meets the goal" if plant.nominal.met else "misses the goal"
        if plant.nominal.unstable:
            words += "; the loop is unstable"
        elif plant.unstable:
            words += f"{', but' if plant.nominal.met else ';'} {instability(plant.margin)}"
        lines.append(f"In {name} the law {words}: plate energy {energy} dB over touch phases.")
        if plant is found.ideal:
            own = plant.nominal.metrics["plate_energy_db"]
            hint = "" if found.other else "--span both searches the limits of each."
            lines += spans_differ(own, found.other_db, found.span, hint)
            if found.why_no_other:
                lines.append(found.why_no_other)
        lines += noise_lines(name, plant)
        if plant.left_out:
            refused = ", ".join(plant.left_out)
            lines.append(f"The real plant is without {refused}, which the scene refuses.")
    return lines


def verdict_line(found: BudgetResult) -> str:
    """Return in one sentence whether the law meets its goal, and what limits it first."""
    goal = " and ".join(map(str, found.goals))
    plants = _plants(found)
    met = [name for name, plant in plants if plant.nominal.met and not plant.unstable]
    missed = [name for name, _ in plants if name not in met]
    words = f"meets its goal {goal} at every touch phase in {' and in '.join(met)}"
    if missed and met:
        words += f", but not in {' and in '.join(missed)}"
    if not met:
        words = f"misses its goal {goal} in {' and in '.join(missed)}"
    first = found.ideal.binds_first
    limits = {limit.quantity: limit.words() for limit in found.ideal.limits}
    binding = "" if first is None else f"; {first} binds first: {limits[first]}"
    return f"{found.scene}: the law {found.law} {words}{binding}."


def noise_lines(name: str, plant: InPlant) -> list[str]:
    """Return a sentence where a law tolerates noise as large as the penetration that it senses."""
    deepest_m = plant.deepest_m
    noise = next((limit for limit in plant.limits if limit.quantity == "noise"), None)
    if deepest_m is None or noise is None or noise.value is None or noise.value < deepest_m:
        return []
    return [
        f"In {name} the tolerated noise, {noise.words()}, is as large as the penetration itself "
        f"({readable.quantity(deepest_m, 'm')} without control): the law meets its goal there "
        "without seeing the contact, so this is no demand on a sensor."
    ]


def wider_lines(found: BudgetResult) -> list[str]:
    """Return a sentence on the quantities of which the real plant tolerates more than the scene."""
    if found.real is None:
        return []
    wider = [
        f"{real.quantity} ({real.words()} against {ideal.words()})"
        for ideal, real in zip(found.ideal.limits, found.real.limits, strict=True)
        if ideal.value is not None
        and real.value is not None
        and (real.value < ideal.value if ideal.quantity in LEAST else real.value > ideal.value)
    ]
    if not wider:
        return []
    return [
        f"The real plant tolerates more of {', '.join(wider)}: its contact is another one, so its "
        "limits need not lie within those of the scene."
    ]


def print_budget(found: BudgetResult) -> None:
    """Print a budget on one screen."""
    for line in effect_lines(found):
        out.say(line)
    plants = _plants(found)
    out.print(_limits_table(plants))
    for name, plant in plants:
        _print_limits(name, plant)
    for line in wider_lines(found):
        out.say(line)
    margin = found.ideal.margin
    if margin is None:
        out.print("Linear margin: none, because the loop in flight is not linear under this law.")
    else:
        for line in margin_lines(margin):
            out.say(line)


def _print_limits(name: str, plant: InPlant) -> None:
    """Print which limit of a plant binds first, and what is special about the others."""
    unstable = [one.quantity for one in plant.limits if one.boundary is Boundary.UNSTABLE]
    if unstable:
        out.say(
            f"In {name} no value of {', '.join(unstable)} is tolerated, because the linear "
            "loop is unstable."
        )
    if plant.binds_first is not None:
        out.print(f"In {name} {plant.binds_first} binds first.")
    elif not unstable:
        out.print(f"In {name} no quantity has a limit.")
    for limit in plant.limits:
        if not limit.interval:
            values = ", ".join(f"{x:.4g}" for x in limit.holds_again[:6])
            out.say(
                f"In {name} the goal is met again at {limit.quantity} = {values}: "
                "the tolerated values are not an interval."
            )
        if limit.reason:
            fails_at = ""
            if limit.first_failure is not None:
                fails_at = readable.quantity(limit.first_failure, limit.unit, 4)
            head = _REASONS[limit.boundary].format(limit, fails_at)
            out.say(f"In {name} {head} {limit.reason}")


def trace_line(latencies_us: Sequence[float]) -> str:
    """Summarise a trace of latencies, us, in a sentence."""
    ordered = sorted(latencies_us)
    median, high = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
    return (
        f"Trace of {len(ordered)} latencies: median {median:g} us, 99 % below {high:g} us, largest "
        f"{ordered[-1]:g} us."
    )


_REASONS = {
    "no limit": "{0.quantity} has no limit:",
    "refused": "the next value of {0.quantity} is refused:",
    "failed": "{0.quantity} at {1} makes a case fail:",
    "not possible": "{0.quantity} cannot be varied.",
}


def _limits_table(plants: list[tuple[str, InPlant]]) -> Table:
    """Return the tolerated values of each quantity, a column for each plant."""
    columns: list[tuple[str, list[str]]] = []
    for name, plant in plants:
        columns.append((name, [limit.words() for limit in plant.limits]))
        if any(limit.impact_alone for limit in plant.limits):
            alone = [(limit.impact_alone or limit).words() for limit in plant.limits]
            columns.append((f"{plant.span} alone", alone))
    first = plants[0][1].limits
    low_high = (
        " to ".join(readable.quantity(end, one.unit) for end in one.searched) for one in first
    )
    columns.append(("searched", list(low_high)))
    title = "Tolerated, each with the other quantities as in the plant"
    table = Table("quantity", right=[heading for heading, _ in columns], title=title)
    for one, *cells in zip(first, *(cells for _, cells in columns), strict=True):
        table.add_row(one.quantity, *cells)
    return table


def print_probability(likely: Probability, worst: str) -> None:
    """Print how likely the goals are met."""
    out.say(probability_line(likely))
    names = ("plate_energy_db", "rebound_percent", "radiated_db", "peak_force_n")
    right = [f"{100 * quantile:g} %" for quantile in likely.quantiles[names[0]]]
    table = Table("metric", right=right, title="Quantiles over the uncertain cases")
    for name in names:
        table.add_row(name, *(f"{x:.4g}" for x in likely.quantiles[name].values()))
    out.print(table)
    out.say(f"Run the worst case again: {worst}")


def probability_line(likely: Probability) -> str:
    """Return how likely the goals are met, in a sentence."""
    low, high = likely.interval
    return (
        f"Probability that the goal is met: {likely.value:z.3f} ({low:z.3f} to {high:z.3f} at "
        f"{100 * likely.confidence:g} %, {likely.cases} cases, {likely.unstable} unstable)."
    )


def check_requirements(path: Path, workers: int | None, json_file: Path | None) -> None:
    """Check a file of requirements; end with exit code 1 if one fails.

    Args:
        path: The requirements, a TOML file.
        workers: Number of processes; None: one for each core.
        json_file: File of --json, if one is given.
    """
    requirements = read_requirements(path)
    setups = [requirement.setup() for requirement in requirements]
    for setup in {setup.scene.controller.law: setup for setup in setups}.values():
        prepare.check_law(setup)
    differing = {(s.scene.name, s.scene.controller.law): s for s in setups}
    prepare.compile_first(*differing.values())
    results = []
    with (
        if_interrupted(),
        progress("requirements", len(requirements)) as advance,
        local_pool(workers) as pool,
    ):
        for requirement in requirements:
            results.append(check(pool, requirement))
            advance(len(results))
    for result in results:
        head = ("holds", "green") if result.passed else ("FAILS", "bold red")
        out.say(unwrapped(head, f"  {result.row.name}"))
        for sentence in (*result.fails, *result.holds):
            out.say(f"    {sentence}")
        for sentence in result.warnings:
            out.say(f"    Warning: {sentence}")
        if not result.passed:
            out.say(f"    Reproduce: {result.command}")
    failed = sum(not result.passed for result in results)
    out.print(f"{len(results) - failed} of {len(results)} requirements hold")
    as_data = [
        {
            "name": result.row.name,
            "scene": result.row.scene,
            "passed": result.passed,
            "holds": result.holds,
            "fails": result.fails,
            "warnings": result.warnings,
            "unstable": result.unstable,
            "measured": result.measured,
            "command": result.command,
        }
        for result in results
    ]
    outputs.write_json(
        json_file,
        {
            "requirements": as_data,
            "passed": not failed,
            "failed": failed,
            "unstable": any(result.unstable for result in results),
        },
    )
    if failed:
        raise typer.Exit(1)
