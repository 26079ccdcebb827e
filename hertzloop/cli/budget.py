"""The command `budget`."""

import shlex
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hertzloop.cli import options
from hertzloop.cli.study_frame import resumable
from hertzloop.cli.terminal import fail, if_interrupted, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.plant_checks import check_conserves
from hertzloop.studies.budget import budget as budget_study
from hertzloop.studies.budget.goal import DEFAULT_GOAL, parse_goal
from hertzloop.studies.budget.limits import NAMES, Boundary, limit_words
from hertzloop.studies.budget.probability import (
    Probability,
    Sensitivity,
    probability,
    sensitivities,
)
from hertzloop.studies.budget.requirements import check, junit, read_requirements
from hertzloop.studies.budget.stability import instability
from hertzloop.studies.margin.shown import margin_lines
from hertzloop.studies.requests import BudgetRequest
from hertzloop.studies.sweeps.design import Design
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.sweeps.sweep import work_of
from hertzloop.studies.sweeps.uncertain import read_uncertain
from hertzloop.views.format import Table, unwrapped
from hertzloop.views.verdict import spans_differ

if TYPE_CHECKING:
    from hertzloop.studies.budget.budget import Budget, InPlant


@options.takes()
def budget(
    request: BudgetRequest,
    scene: options.SceneArgument = DEFAULT,
    law: str | None = None,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    trace: Path | None = None,
    uncertain_file: Annotated[Path | None, typer.Option("--uncertain")] = None,
    requirements: Annotated[Path | None, typer.Option("--check")] = None,
    junit_file: Annotated[Path | None, typer.Option("--junit")] = None,
    folder: Annotated[Path | None, typer.Option("--out-dir", "-o")] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Find how much latency and how few bits a law tolerates.

    It also searches jitter, noise, sampling period, and the bandwidth and mass of the actuator.

    The same command continues an interrupted search.

    Args:
        law: Law: a shipped name or a file; the scene's if not given.
        trace: Latencies by sample in place of controller.latency_us: a CSV file, or a recording of
            a paced run (.mcap).
        uncertain_file: Compute the probability of the goal for the distributions in this TOML file,
            or in the tables [uncertain] and [fit] of this scene.
        requirements: Check the requirements in this file instead of searching.
        junit_file: Write the results of --check to this file as JUnit XML.
        folder: Folder for the results as a page.
    """
    options.check_json(json_file)
    options.check_folder(junit_file)
    if requirements is not None:
        check_requirements(requirements, request.workers, junit_file, json_file)
        return
    if junit_file is not None:
        fail("--junit needs --check. Name a file of requirements")
    given = [*(settings or []), *([f"controller.law={law}"] if law is not None else [])]
    if trace is not None:
        given += ["controller.latency_us=0", f"controller.latency_trace={trace}"]
    resolved = options.scene_from(scene, given, seed)
    check_conserves(resolved.scheme)
    wanted = [parse_goal(text) for text in request.goals or [DEFAULT_GOAL]]
    sobol, quick, of = request.sobol, request.quick, request.first_span
    if not resolved.has_law:
        raise SceneError(
            "controller.law = 'off': has no limits. Name a law, for example --law slope_threshold"
        )
    for name in request.only:
        if name not in NAMES:
            raise SceneError(
                f"--only = '{name}': is not a quantity. Choose from {', '.join(NAMES)}"
            )
    uncertain = read_uncertain(uncertain_file, resolved) if uncertain_file else None
    if sobol and not uncertain:
        raise SceneError("--sobol needs --uncertain. Name a file of distributions")
    if sobol & (sobol - 1):
        raise SceneError(f"--sobol = {sobol}: must be a power of 2, for example 256")
    if sobol:
        need("SALib")
    if folder is not None:
        need("matplotlib", "jinja2")
    options.make_folder(folder or Path())  # for unfinished work, too
    options.compile_first(resolved)
    header = {
        **work_of([resolved], [resolved.law_reference], Design(())),
        "budget": [*map(str, wanted), request.span, quick, request.with_real, *request.only],
    }
    began_s = time.perf_counter()
    with (
        resumable(folder or Path(), "budget", header) as finished,
        progress("budget", 1000) as advance,
        local_pool(request.workers) as pool,
    ):
        found = budget_study.budget(
            finished.of(pool), resolved, wanted, request,
            lambda share: advance(round(1000 * share)),
        )  # fmt: skip
        mapped = None
        if folder is not None:
            from hertzloop.studies.budget.page import map_of  # of an extra

            mapped = map_of(finished.of(pool), resolved, wanted, of, found.ideal, quick)
        likely, indices = None, []
        if uncertain:
            counted = finished.of(pool)
            likely = probability(
                counted,
                resolved,
                wanted,
                uncertain,
                of,
                within=request.within,
                most=request.most_cases,
            )
            if sobol:
                indices = sensitivities(counted, resolved, wanted, uncertain, of, sobol)
    latencies = resolved.scene.controller.latency_trace
    if latencies:
        out.print(_trace_words(latencies))
    print_budget(found)
    data = budget_study.as_data(found)
    if likely:
        worst = run_command(scene, given, resolved.seed, likely.worst)
        print_probability(likely, indices, worst)
        data["probability"] = {
            **{key: value for key, value in asdict(likely).items() if key != "drawn"},
            "worst_command": worst,
            "drawn": list(likely.drawn),
            "sobol": [asdict(index) for index in indices],
        }
    total = found.cases + (likely.cases if likely else 0)
    total += sobol * (len(uncertain.parts) + 2) if uncertain and sobol else 0
    out.print(f"{total} cases in {time.perf_counter() - began_s:z.1f} s")
    if folder is not None:
        from hertzloop.studies.budget.page import write_page  # of an extra

        lines = effect_lines(found)
        if likely:
            lines.append(probability_line(likely))
        command = shlex.join(
            ["hertzloop", "budget", scene, *(part for one in given for part in ("--set", one)),
             *(part for goal in wanted for part in ("--goal", str(goal))),
             *(["--quick"] if quick else []), "--out-dir", str(folder)]
        )  # fmt: skip
        page = write_page(folder, resolved, found, mapped, lines, command)
        out.say(f"written: {page}")
    options.write_json(json_file, data)


def run_command(scene: str, settings: list[str], seed: int, case: dict[str, Any]) -> str:
    """Return the command that runs a case again."""
    words = [*settings, *(f"{key}={value}" for key, value in case.items())]
    given = [part for word in words for part in ("--set", word)]
    seeded = [] if "run.seed" in case else ["--seed", str(seed)]
    return shlex.join(["hertzloop", "run", scene, *given, *seeded])


def print_probability(likely: Probability, indices: Sequence[Sensitivity], worst: str) -> None:
    """Print how likely the goals are met."""
    out.say(probability_line(likely))
    names = ("plate_energy_db", "rebound_percent", "radiated_db", "peak_force_n")
    right = [f"{100 * quantile:g} %" for quantile in likely.quantiles[names[0]]]
    table = Table("figure", right=right, title="Quantiles over the uncertain cases")
    for name in names:
        table.add_row(name, *(f"{x:.4g}" for x in likely.quantiles[name].values()))
    out.print(table)
    if indices:
        title = "Sobol indices, each with half its 95 % interval"
        shares = Table("keys", right=("figure", "first order", "total"), title=title)
        for one in indices:
            shares.add_row(
                ", ".join(one.keys), one.figure, f"{one.first:z.3f} ± {one.first_half:z.3f}",
                f"{one.total:z.3f} ± {one.total_half:z.3f}",
            )  # fmt: skip
        out.print(shares)
    out.say(f"Run the worst case again: {worst}")


def check_requirements(
    path: Path, workers: int | None, junit_file: Path | None, json_file: Path | None
) -> None:
    """Check a file of requirements; end with exit code 1 if one fails."""
    found = []
    rows = read_requirements(path)
    setups = [row.setup() for row in rows]
    for setup in {setup.law_reference: setup for setup in setups}.values():
        options.check_law(setup)
    options.compile_first(*{(s.name, s.law_reference): s for s in setups}.values())
    with (
        if_interrupted(), progress("requirements", len(rows)) as advance,
        local_pool(workers) as pool,
    ):  # fmt: skip
        for row in rows:
            found.append(check(pool, row))
            advance(len(found))
    for one in found:
        head = ("holds", "green") if one.passed else ("FAILS", "bold red")
        out.say(unwrapped(head, f"  {one.row.name}"))
        for sentence in (*one.fails, *one.holds):
            out.say(f"    {sentence}")
        for sentence in one.warnings:
            out.say(f"    Warning: {sentence}")
        if not one.passed:
            out.say(f"    Reproduce: {one.command}")
    failed = [one for one in found if not one.passed]
    out.print(f"{len(found) - len(failed)} of {len(found)} requirements hold")
    if junit_file is not None:
        junit(junit_file, found)
    rows_of = [
        {"name": one.row.name, "scene": one.row.scene, "passed": one.passed,
         "holds": list(one.holds), "fails": list(one.fails),
         "warnings": list(one.warnings), "unstable": one.unstable,
         "measured": one.measured, "command": one.command, "seconds": one.seconds}
        for one in found
    ]  # fmt: skip
    options.write_json(json_file, {
        "requirements": rows_of, "passed": not failed, "failed": len(failed),
        "unstable": any(one.unstable for one in found),
    })  # fmt: skip
    if failed:
        raise typer.Exit(1)


def probability_line(likely: Probability) -> str:
    """Return how likely the goals are met, in a sentence."""
    low, high = likely.interval
    return (
        f"Probability that the goal is met: {likely.value:z.3f} ({low:z.3f} to {high:z.3f} at "
        f"{100 * likely.confidence:g} %, {likely.cases} cases, {likely.unstable} unstable)."
    )


def _plants(found: "Budget") -> "list[tuple[str, InPlant]]":
    real = [("the real plant", found.real)] if found.real else []
    if not found.other:
        return [("the scene", found.ideal), *real]
    return [("the first impact", found.ideal), ("the whole run", found.other), *real]


def effect_lines(found: "Budget") -> list[str]:
    """Return the goal, and what the law does in each plant, in sentences."""
    goal = " and ".join(map(str, found.goals))
    lines = [f"{found.scene}, law {found.law}. Goal: {goal}, at every touch phase."]
    for name, plant in _plants(found):
        energy = plant.nominal.over_phases["plate_energy_db"]
        words = "meets the goal" if plant.nominal.met else "misses the goal"
        if plant.nominal.unstable:
            words += "; the loop is unstable"
        elif plant.unstable:
            words += f"{', but' if plant.nominal.met else ';'} {instability(plant.margin)}"
        lines.append(f"In {name} the law {words}: plate energy {energy} dB over touch phases.")
        if plant is found.ideal:
            own = plant.nominal.figures["plate_energy_db"]
            hint = "" if found.other else "--span both searches the limits of each."
            lines += spans_differ(own, found.other_db, found.span, hint)
        if plant.left_out:
            refused = ", ".join(plant.left_out)
            lines.append(f"The real plant is without {refused}, which the scene refuses.")
    return lines


def print_budget(found: "Budget") -> None:
    """Print a budget on one screen."""
    for line in effect_lines(found):
        out.say(line)
    plants = _plants(found)
    out.print(_limits_table(plants))
    for name, plant in plants:
        first = plant.binds_first
        none = [one.quantity for one in plant.limits if one.boundary is Boundary.UNSTABLE]
        if none:
            out.say(f"In {name} no value of {', '.join(none)} is tolerated, because the linear "
                      "loop is unstable.")  # fmt: skip
        if first is not None:
            out.print(f"In {name} {first} binds first.")
        elif not none:
            out.print(f"In {name} no quantity has a limit.")
        for limit in plant.limits:
            if not limit.interval:
                places = ", ".join(f"{x:.4g}" for x in limit.holds_again[:6])
                out.say(f"In {name} the goal is met again at {limit.quantity} = {places}: "
                          "the tolerated values are not an interval.")  # fmt: skip
            if limit.reason:
                says = _REASONS[limit.boundary].format(limit)
                out.say(f"In {name} {says} {limit.reason}")
    margin = found.ideal.margin
    if margin is None:
        out.print("Linear margin: none, because the loop in flight is not linear under this law.")
    else:
        for line in margin_lines(margin):
            out.say(line)


def _trace_words(latencies: Sequence[float]) -> str:
    """Return what a trace of latencies (us) holds, in a sentence."""
    ordered = sorted(latencies)
    middle, much = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
    return (
        f"Trace of {len(ordered)} latencies: median {middle:g} us, 99 % below {much:g} us, largest "
        f"{ordered[-1]:g} us."
    )


_REASONS = {
    "no limit": "{0.quantity} has no limit:",
    "refused": "{0.quantity} beyond {0.value:.4g} {0.unit} is refused:",
    "not possible": "{0.quantity} cannot be varied.",
}


def _limits_table(plants: "list[tuple[str, InPlant]]") -> Table:
    columns: list[tuple[str, list[str]]] = []
    for name, plant in plants:
        columns.append((name, [limit_words(limit) for limit in plant.limits]))
        if any(limit.impact_alone for limit in plant.limits):
            alone = [limit_words(limit.impact_alone or limit) for limit in plant.limits]
            columns.append((f"{plant.span} alone", alone))
    first = plants[0][1].limits
    low_high = (f"{one.searched[0]:.3g} to {one.searched[1]:.3g} {one.unit}" for one in first)
    columns.append(("searched", list(low_high)))
    title = "Tolerated, each with the other quantities as in the plant"
    table = Table("quantity", right=[heading for heading, _ in columns], title=title)
    for one, *cells in zip(first, *(cells for _, cells in columns), strict=True):
        table.add_row(one.quantity, *cells)
    return table
