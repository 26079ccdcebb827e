"""The command `sweep`: simulate many cases of a scene, and print what they show."""

import math
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
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
from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.common.readable import quantity
from hertzloop.processes.program import LARGEST_PORT
from hertzloop.results.predictability import whole_run_known
from hertzloop.results.spans import OTHER, Span
from hertzloop.results.touch_phases import TOUCH_PHASE_KEY
from hertzloop.scene.loading import DEFAULT, parse_setting
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import Rows, metrics_with_values, with_metric
from hertzloop.studies.cases.touch_phases import grouped
from hertzloop.studies.cases.workers import WorkersLost
from hertzloop.studies.pages.words import short
from hertzloop.studies.sweep import sweep as sweep_study
from hertzloop.studies.sweep.plan import SweepPlan, plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.result import SweepResult, counted, extremes
from hertzloop.views.format import Table, unwrapped
from hertzloop.views.verdict import spans_differ

_CONTACTS = 60.0  # contact times in which an impact is over
_MOST_ROWS = 20  # of a table
_WORTH = 3.0  # ratio of times from which a hint is worth a line


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
        prepare.compile_first(setup)
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


def count_without_metrics(results: SweepResult) -> int:
    """Return how many cases failed, or are unstable and have no metrics."""
    return len(results.without_result) + results.unstable


def print_results(plan: SweepPlan, target: Path, results: SweepResult) -> dict[str, Any]:
    """Print what a sweep found, whose results are in `target`, and return it as plain data."""
    total, keys, rows = len(plan.cases), plan.design.keys, results.rows
    request = plan.request
    for number in results.damaged:
        journal = sweep_study.journal_of(target)
        err.say(f"line {number} of {journal} was damaged. Its case was run again.")
    has_metrics = count_without_metrics(results) < total
    is_uncertain = request.uncertain is not None
    if has_metrics and not is_uncertain and (len(keys) == 1 or are_few(rows)):
        out.print(cases_table(rows, keys))
    if has_metrics:
        out.print(extremes_table(rows, keys))
    if not is_uncertain:
        _print_best(plan, results)
    if is_uncertain and has_metrics:
        out.print(quantiles_table(rows, [axis.key for axis in plan.design.axes]))
    phased = TOUCH_PHASE_KEY in keys and request.design == "grid" and not is_uncertain
    shown = tuple(metrics_with_values(rows))
    over_phases = grouped(rows, keys, shown) if phased and shown else []
    if over_phases:
        others = [key for key in keys if key != TOUCH_PHASE_KEY]
        out.print(phases_table(over_phases, others, shown[:2]))
    rate = results.ran / results.wall_s if results.wall_s else 0.0
    kept = f"{total - results.ran} finished before, " if results.ran < total else ""
    out.say(
        f"{total} cases: {kept}{results.ran} run in {results.wall_s:z.2f} s, {rate:z.0f} cases/s. "
        f"Results: {target}"
    )
    for hint in flight_lines(plan.setup, request.span, rows):
        out.say(hint)
    out_of_range = counted(rows, "out_of_range")
    _print_warnings(results, total, out_of_range)
    return {
        "cases": total,
        "ran": results.ran,
        "wall_s": results.wall_s,
        "cases_per_s": rate,
        "failed": len(results.without_result),
        "unstable": results.unstable,
        "unstable_loops": len(results.growing),
        "damaged_lines": results.damaged,
        "leaves_out": counted(rows, "leaves_out"),
        "out_of_range": out_of_range,
        "over_phases": [
            {key: asdict(value) if key in shown else value for key, value in group.items()}
            for group in over_phases
        ],
        "results": str(target),
    }


def draw_results(picture: Path, plan: SweepPlan, results: SweepResult) -> None:
    """Draw the metrics of a sweep into a file; say so if no case has any."""
    from hertzloop.studies.pages import pictures  # of an extra, as the next
    from hertzloop.studies.sweep.chart import draw

    if count_without_metrics(results) == len(plan.cases):
        err.say(f"{picture}: not written, because no case has metrics.")
        return
    pictures.save(draw(results.rows, plan.design.keys, plan.design.kind), picture)
    out.say(f"Picture: {picture}")


def flight_lines(setup: Setup, span: Span, rows: Rows) -> list[str]:
    """Return a hint where most of the time that the first impacts take to simulate is flight."""
    having = with_metric(rows, "contact_us")
    if span != "impact" or not having or {"run.duration_s", "run.step_ns"} & set(having[0]):
        return []
    contact_s = 1e-6 * max(row["contact_us"] for row in having)
    simulated_s = setup.run.step_s * sum(row["steps"] for row in having) / len(having)
    enough_s = setup.first_touch_s + _CONTACTS * contact_s
    if simulated_s < _WORTH * enough_s:
        return []
    return [
        f"Most of the simulated time is flight: a case simulates {quantity(simulated_s, 's')} on "
        f"average, a contact lasts {quantity(contact_s, 's')} at most. "
        f"--set run.duration_s={1.05 * enough_s:.2g} is about {simulated_s / enough_s:.0f} times "
        "faster."
    ]


def _print_best(plan: SweepPlan, results: SweepResult) -> None:
    """Say whether the case with the least plate energy looks different over the other span."""
    request, rows = plan.request, with_metric(results.rows, "plate_energy_db")
    if not rows:
        return
    best, other_span = min(rows, key=lambda row: row["plate_energy_db"]), OTHER[request.span]
    values = {key: best[key] for key in plan.design.keys}
    try:
        # Two processes at most: a law that is not shipped may crash the one that runs it.
        with local_pool(min(request.workers or 2, 2)) as pool:
            (other,) = evaluate(pool, plan.setup, other_span, [values])
    except WorkersLost as error:
        err.say(f"The case with the least plate energy has no value over the other span: {error}.")
        return
    for sentence in spans_differ(
        best["plate_energy_db"],
        other["plate_energy_db"],
        request.span,
        f"--span {other_span} sweeps the other.",
    ):
        if not whole_run_known(plan.setup.vary(values)):
            sentence = "Later impacts are not predictable."
        out.say(f"At the least plate energy: {sentence}")


def _print_warnings(results: SweepResult, total: int, out_of_range: dict[str, int]) -> None:
    """Print which effects are out of range, and how many cases or loops are unstable."""
    if out_of_range:
        effects = ", ".join(f"{name} in {n} of {total} cases" for name, n in out_of_range.items())
        out.say(unwrapped(("OUT OF RANGE:", "bold red"), f" {effects}"))
    if results.unstable:
        out.print(f"{results.unstable} of {total} cases are unstable and have no metrics.")
    growing = results.growing
    if growing:
        largest = max((rate for rate in growing if not math.isnan(rate)), default=math.nan)
        size = "" if math.isnan(largest) else f"; the loop grows up to {largest:.4g}/s"
        out.say(
            unwrapped(
                ("Linear loop unstable", "bold red"),
                f" in {len(growing)} of {total} cases that are too short to show it{size} "
                "(column growth_per_s).",
            )
        )


def extremes_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return the least and the largest value of each metric, and the keys that gave them."""
    table = Table(title="Against no control")
    for heading in ("metric", "least", "at", "largest", "at"):
        table.add_column(heading, justify="left" if heading in ("metric", "at") else "right")
    for metric, *words in extremes(rows, keys, metrics_with_values(rows)):
        table.add_row(metric, *words)
    return table


def cases_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return keys and metrics of each case; of many cases every so many."""
    every = max(1, -(-len(rows) // _MOST_ROWS))
    shown = rows[::every]
    names = metrics_with_values(rows)
    count = f"{len(shown)} of {len(rows)} cases" if every > 1 else "All cases"
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title=f"{count}, against no control")
    for row in shown:
        cells = (f"{row[name]:z.2f}" if with_metric([row], name) else "" for name in names)
        table.add_row(*(short(row[key]) for key in keys), *cells)
    return table


def are_few(rows: list[dict[str, Any]]) -> bool:
    """Return whether a table shows every case."""
    return len(rows) <= _MOST_ROWS


def quantiles_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return median and 95 % range of metrics over the draws; a row for each setting of `keys`."""
    # As many metrics as fit side by side in 80 columns.
    names = metrics_with_values(rows)[: max(2, 4 - len(keys))]
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title="Over draws of the uncertain keys: median (2.5 to 97.5 %)")
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    for values, group in list(groups.items())[:_MOST_ROWS]:
        cells = []
        for name in names:
            having = [row[name] for row in with_metric(group, name)] or [math.nan]
            low, middle, high = np.percentile(having, [2.5, 50.0, 97.5])
            cells.append(f"{middle:.4g} ({low:.4g} to {high:.4g})")
        table.add_row(*(short(value) for value in values), *cells)
    return table


def phases_table(groups: list[dict[str, Any]], keys: list[str], metrics: Sequence[str]) -> Table:
    """Return mean and range over the touch phase; a row for each setting of the other keys."""
    right = [*(key.split(".")[-1] for key in keys), *metrics]
    table = Table(right=right, title="Over touch phases: mean (least to most)")
    for group in groups[:_MOST_ROWS]:
        table.add_row(*(short(group[key]) for key in keys), *(str(group[f]) for f in metrics))
    if len(groups) > _MOST_ROWS:
        table.caption = f"and {len(groups) - _MOST_ROWS} more; --json has them all"
    return table
