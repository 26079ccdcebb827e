"""The command `budget`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_json,
    check_writable,
    compile_first,
    fail,
    make_folder,
    out,
    progress,
    scene_from,
    write_json,
)
from hertzloop.cli.study_frame import resumable
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT, NO_CASE_OF_THESIS
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from hertzloop.studies.budget.budget import Budget, InPlant
    from hertzloop.studies.budget.limits import Limit


def budget(
    scene: SceneArgument = DEFAULT,
    law: Annotated[
        str | None, typer.Option(help="Law: a shipped name or a file; the scene's if not given.")
    ] = None,
    goals: Annotated[
        list[str] | None,
        typer.Option(
            "--goal",
            help="Condition that the law must meet at every touch phase, e.g. "
            "'plate_energy_db <= -3'. May be given several times. Default: "
            "plate_energy_db <= -0.1.",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Search coarsely, with a thin plate as the real one.")
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Quantity to search, e.g. latency_us. May be given several times."),
    ] = None,
    with_real: Annotated[
        bool, typer.Option("--real-plant/--no-real-plant", help="Search in the real plant too.")
    ] = True,
    span: Annotated[
        Literal["impact", "run"],
        typer.Option(help="Take figures of the first impact, or of the whole run."),
    ] = "impact",
    settings: SetOption = None,
    seed: SeedOption = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes; all cores if not given.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out-dir", "-o", help="Folder for the results as a page.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Find how much latency, jitter and noise and how few bits a law tolerates.

    The same command continues an interrupted search.

    Example: hertzloop budget aluminium-3mm --law mine.py --goal 'plate_energy_db <= -3'
    """
    from hertzloop.plant.schemes.registry import SCHEMES
    from hertzloop.studies.budget import budget as study
    from hertzloop.studies.budget.goal import DEFAULT_GOAL, parse_goal
    from hertzloop.studies.budget.limits import quantities_of
    from hertzloop.studies.sweeps.design import Design
    from hertzloop.studies.sweeps.pool import local_pool
    from hertzloop.studies.sweeps.sweep import work_of

    check_json(json_file)
    given = [*(settings or []), *([f"controller.law={law}"] if law is not None else [])]
    resolved = scene_from(scene, given, seed)
    if not SCHEMES[resolved.scheme].conserves:
        fail(NO_CASE_OF_THESIS, 2)
    try:
        wanted = [parse_goal(text) for text in goals or [DEFAULT_GOAL]]
        if not resolved.has_law:
            raise SceneError(
                "controller.law = 'off': has no limits. Name a law, for example --law "
                "slope_threshold"
            )
        names = [quantity.name for quantity in quantities_of(resolved)]
        for name in only or []:
            if name not in names:
                raise SceneError(
                    f"--only = '{name}': is not a quantity. Choose from {', '.join(names)}"
                )
    except SceneError as error:
        fail(str(error), 2)
    if folder is not None:
        make_folder(folder)
    else:
        check_writable(Path())  # for unfinished work
    compile_first(resolved)
    header = {
        **work_of([resolved], [resolved.law_reference], Design(())),
        "budget": [*map(str, wanted), span, quick, with_real, *(only or [])],
    }
    began_s = time.perf_counter()
    try:
        with (
            resumable(folder or Path(), "budget", header) as finished,
            progress("budget", 1000) as advance,
            local_pool(workers) as pool,
        ):
            found = study.budget(
                finished.of(pool), resolved, wanted, span, quick=quick, with_real=with_real,
                only=only or (), on_progress=lambda share: advance(round(1000 * share)),
            )  # fmt: skip
    except SceneError as error:
        fail(str(error), 2)
    print_budget(found)
    out.print(f"{found.cases} cases in {time.perf_counter() - began_s:.1f} s")
    write_json(json_file, study.as_data(found))


def print_budget(found: "Budget") -> None:
    """Print a budget on one screen."""
    goal = " and ".join(map(str, found.goals))
    out.print(f"{found.scene}, law {found.law}. Goal: {goal}, at every touch phase.",
              soft_wrap=True)  # fmt: skip
    plants = [("the scene", found.ideal)]
    if found.real:
        plants.append(("the real plant", found.real))
    for name, plant in plants:
        energy = plant.nominal.over_phases["plate_energy_db"]
        words = "meets the goal" if plant.nominal.met else "misses the goal"
        if plant.nominal.unstable:
            words += "; the loop is unstable"
        out.print(f"In {name} the law {words}: plate energy {energy} dB over touch phases.",
                  soft_wrap=True)  # fmt: skip
        if plant.left_out:
            out.print(f"  Not part of it, as the scene refuses them: {', '.join(plant.left_out)}",
                      soft_wrap=True)  # fmt: skip
    out.print(_limits_table(plants))
    for name, plant in plants:
        first = plant.binds_first
        if first is None:
            out.print(f"In {name} no limit was found in the ranges searched.")
        else:
            out.print(f"In {name} {first} binds first.")
        for limit in plant.limits:
            if not limit.interval:
                places = ", ".join(f"{x:.4g}" for x in limit.holds_again[:6])
                out.print(f"In {name} the goal is met again at {limit.quantity} = {places}: "
                          "the tolerated values are not an interval.", soft_wrap=True)  # fmt: skip
    if found.margin is None:
        out.print("Linear margin: not available.")


_MOST = ("bits", "bandwidth_hz")  # the limit is the least value, not the largest


def _limits_table(plants: "list[tuple[str, InPlant]]") -> Table:
    """Limits, a quantity a row, a plant a column."""
    table = Table(title="Tolerated, each with the other quantities as in the plant")
    table.add_column("quantity")
    for name, _ in plants:
        table.add_column(name, justify="right")
    table.add_column("searched", justify="right")
    for rows in zip(*(plant.limits for _, plant in plants), strict=True):
        one = rows[0]
        low, high = one.searched
        searched = f"{low:.3g} to {high:.3g} {one.unit}"
        table.add_row(one.quantity, *map(limit_words, rows), searched)
    return table


def limit_words(limit: "Limit") -> str:
    """Return a limit in words."""
    if limit.value is not None:
        least = limit.quantity in _MOST
        return f"{'at least' if least else 'up to'} {limit.value:.4g} {limit.unit}"
    return limit.boundary.value


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(budget)
