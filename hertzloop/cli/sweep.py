"""The command `sweep`: simulate many cases of a scene, and print what they show."""

import math
from collections.abc import Callable, Sequence
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
from hertzloop.results.predictability import whole_run_known
from hertzloop.results.spans import OTHER
from hertzloop.results.touch_phases import TOUCH_PHASE_KEY, spread_of
from hertzloop.scene.loading import DEFAULT, parse_setting
from hertzloop.studies.cases.evaluate import evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import (
    Rows,
    metric_of,
    metrics_with_values,
    with_equal,
    with_metric,
)
from hertzloop.studies.cases.touch_phases import grouped
from hertzloop.studies.cases.workers import WorkersLost
from hertzloop.studies.pages.words import short
from hertzloop.studies.sweep import sweep as sweep_study
from hertzloop.studies.sweep.plan import SweepPlan, plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.result import SweepResult, counted
from hertzloop.views.format import Table, unwrapped
from hertzloop.views.verdict import spans_differ

_MOST_ROWS = 20  # of a table


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
        need("distributed")
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
    names = metrics_with_values(rows)
    draws, phases = request.uncertain is not None, TOUCH_PHASE_KEY in keys
    over_phases: list[dict[str, Any]] = []
    if draws and names:
        axes = [axis.key for axis in plan.design.axes]
        title = "Over draws of the uncertain keys: median (2.5 to 97.5 %)"
        # As many metrics as fit side by side in 80 columns.
        out.print(settings_table(rows, axes, names[: max(2, 4 - len(axes))], title, _quantiles))
    elif names and (len(keys) == 1 or len(rows) <= _MOST_ROWS):
        title = "Cases, against no control"
        out.print(settings_table(rows, keys, names, title, _value))
    if names:
        out.print(extremes_table(rows, keys, names))
    if not draws:
        _print_best(plan, results)
    if phases and names and request.design == "grid" and not draws:
        others = [key for key in keys if key != TOUCH_PHASE_KEY]
        over_phases = grouped(rows, others, names)
        title = "Over touch phases: mean (least to most)"
        out.print(settings_table(rows, others, names[:2], title, _spread))
    rate = results.ran / results.wall_s if results.wall_s else 0.0
    kept = f"{total - results.ran} finished before, " if results.ran < total else ""
    out.say(
        f"{total} cases: {kept}{results.ran} run in {results.wall_s:z.2f} s, {rate:z.0f} cases/s. "
        f"Results: {target}"
    )
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
        "over_phases": over_phases,
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


def extremes_table(rows: Rows, keys: list[str], names: Sequence[str]) -> Table:
    """Return the least and the largest value of each metric, and the keys that gave them."""
    table = Table(title="Against no control")
    for heading in ("metric", "least", "at", "largest", "at"):
        table.add_column(heading, justify="left" if heading in ("metric", "at") else "right")
    for name in names:
        cells = []
        for pick in (min, max):
            row = pick(with_metric(rows, name), key=lambda row: row[name])
            at = ", ".join(f"{key.split('.')[-1]} {short(row[key])}" for key in keys)
            cells += [f"{row[name]:z.2f}", at]
        table.add_row(name, *cells)
    return table


def settings_table(
    rows: Rows,
    keys: list[str],
    names: Sequence[str],
    title: str,
    words: Callable[[list[float]], str],
) -> Table:
    """Return keys and metrics, a line for the rows that agree in `keys`; of many every so many.

    Args:
        rows: Rows of the cases.
        keys: Keys that tell the lines apart.
        names: The metrics.
        title: Title of the table.
        words: What a cell says of the values of a metric in the rows of its line.
    """
    groups = with_equal(rows, keys)
    shown = groups[:: -(-len(groups) // _MOST_ROWS)]
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title=title)
    if len(shown) < len(groups):
        table.caption = f"{len(shown)} of {len(groups)}; the file of results has all"
    for group in shown:
        values = ([metric_of(row, name) for row in group] for name in names)
        table.add_row(*(short(group[0][key]) for key in keys), *map(words, values))
    return table


def _value(values: list[float]) -> str:
    """Return the metric of a case; empty without one."""
    return "" if math.isnan(values[0]) else f"{values[0]:z.2f}"


def _spread(values: list[float]) -> str:
    """Return mean, least and largest value."""
    return str(spread_of(values))


def _quantiles(values: list[float]) -> str:
    """Return median and 95 % range of the values that are known."""
    known = [value for value in values if not math.isnan(value)] or [math.nan]
    low, middle, high = np.percentile(known, [2.5, 50.0, 97.5])
    return f"{middle:.4g} ({low:.4g} to {high:.4g})"
