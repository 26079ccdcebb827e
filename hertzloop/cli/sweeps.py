"""The command `sweep`: simulate many cases of a scene, or verify earlier results."""

import math
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.cli import options, outputs, prepare, worst_latencies
from hertzloop.cli.many_cases import cases_are_kept, end_if_failed
from hertzloop.cli.sweep_tables import extremes_table, phases_table, quantiles_table
from hertzloop.cli.sweep_verify import verify as verify_results
from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.cli.unused_options import check_only_used, check_unused
from hertzloop.common.optional_dependencies import need
from hertzloop.loop.run_options import Transport
from hertzloop.processes.program import LARGEST_PORT
from hertzloop.results.cases import OTHER, SHOWN
from hertzloop.scene.loading import DEFAULT, parse_setting
from hertzloop.studies.cases.evaluate import Rows, run_case, with_metric
from hertzloop.studies.cases.touch_phases import TOUCH_PHASE_KEY, grouped
from hertzloop.studies.pages.words import short
from hertzloop.studies.sweep import sweep as sweep_study
from hertzloop.studies.sweep.plan import SweepPlan, plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.result import SweepResult, counted, worst_row
from hertzloop.studies.worst.of_case import WORST_CASES, worst_columns
from hertzloop.views.format import unwrapped
from hertzloop.views.verdict import spans_differ
from hertzloop.warmup import CASES

OverOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Vary a scene key: key=low:high:step, key=a,b,c, or key=low:high for spread points; "
        "repeatable."
    ),
]
DesignOption = Annotated[
    Literal["grid", "lhs", "sobol"],
    typer.Option(help="Run all combinations, or points spread over the ranges."),
]
CasesOption = Annotated[
    int | None,
    typer.Option(min=1, help="Run this many spread points; default: 256, with --verify 10."),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Use this many processes; default: one for each core.")
]
PhasesOption = Annotated[
    int | None,
    typer.Option(
        min=2,
        max=1000,
        help="Run every case at this many touch phases; print mean and range.",
    ),
]
UncertainOption = Annotated[
    Path | None,
    typer.Option(
        help="Run every case with --cases draws from the distributions in this TOML file, or "
        "in the tables \\[uncertain] and \\[fit] of this scene."
    ),
]
DaskOption = Annotated[
    str | None,
    typer.Option(help="Use the Dask scheduler at this address, for example tcp://host:8786."),
]
WorstOption = Annotated[
    str | None,
    typer.Option(
        metavar="METRIC",
        help="Search the latencies within the jitter of each case for the largest value of this "
        "metric, and write those of the worst case as a trace; up to 2000 cases each.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Write the results to this .parquet or .csv file."),
]
VerifyOption = Annotated[
    Path | None,
    typer.Option(
        metavar="RESULTS",
        help="Repeat --cases cases of these results over --transport and compare all bytes; exit "
        "code 1 if any differ.",
    ),
]
TransportOption = Annotated[Transport, typer.Option(help="Use this transport for --verify.")]

_CAN_CONTINUE = "finished cases are kept. Run the same command again to continue"


@dataclass(frozen=True)
class SweepArguments:
    """What `hertzloop sweep` was called with. `request`: which cases to run, and where."""

    request: SweepRequest
    scene: str
    settings: list[str]
    seed: int | None
    out_file: Path | None
    overwrite: bool
    json_file: Path | None


def sweep(
    context: typer.Context,
    over: OverOption = None,
    design: DesignOption = "grid",
    cases: CasesOption = None,
    span: options.SpanOption = "impact",
    workers: WorkersOption = None,
    phases: PhasesOption = None,
    uncertain: UncertainOption = None,
    dask: DaskOption = None,
    worst: WorstOption = None,
    scene: options.SceneArgument = DEFAULT,
    out_file: OutOption = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
    verify: VerifyOption = None,
    transport: TransportOption = Transport.ZENOH,
    json_file: options.JsonOption = None,
) -> None:
    """Simulate a scene over ranges of its keys.

    The results have a row for every case. A killed sweep goes on with the same command.
    """
    if verify is not None:
        used = {"verify", "cases", "transport", "seed", "json_file"}
        check_only_used(context, used, "with --verify")
        count = 10 if cases is None else cases
        verify_results(verify, count, transport, 1 if seed is None else seed, json_file)
        return
    check_unused(context, {"transport"}, "without --verify")
    request = SweepRequest(over or (), design, cases, span, workers, phases, uncertain, dask, worst)
    arguments = SweepArguments(request, scene, settings or [], seed, out_file, overwrite, json_file)
    study = _checked(arguments)
    if study.finished is None:
        prepare.compile_first(study.plan.setup, works=CASES)
        results = _run(study)
    else:
        results = study.finished
        err.say(f"{study.results_file} has the results of this sweep. --overwrite runs it again.")
    data = _print_results(study, results, request)
    if request.worst is not None:
        data["worst"] = _report_worst(arguments, study, results.rows, request.worst)
    outputs.write_json(json_file, data)
    without_metrics = _count_without_metrics(results) == study.total
    if without_metrics:
        out.print(f"No case of {study.total} has metrics.")
    end_if_failed([row["status"] for row in results.not_run], study.total)
    if without_metrics:
        raise typer.Exit(1)


@dataclass(frozen=True)
class _Study:
    """A sweep that can be run: its cases, its file, and the results that the file already has."""

    plan: SweepPlan
    results_file: Path
    finished: SweepResult | None

    @property
    def total(self) -> int:
        """Number of cases."""
        return len(self.plan.cases)

    @property
    def worst_file(self) -> Path:
        """The file that takes the latencies of the worst case."""
        return self.results_file.with_name(f"{self.results_file.stem}-worst-latencies.csv")


def _checked(arguments: SweepArguments) -> _Study:
    """Return the sweep to run; end the command if it cannot be run or written."""
    request, settings = arguments.request, arguments.settings
    setup = prepare.scene_from(arguments.scene, settings, arguments.seed)
    target = arguments.out_file or Path(f"{setup.name}-sweep.parquet")
    if target.suffix not in (".parquet", ".csv"):
        fail(f"--out = {target}: unknown format. Use a name that ends in .parquet or .csv.")
    if request.dask is not None:
        _check_scheduler(request.dask)
    plan = plan_sweep(setup, request)
    _check_not_swept(arguments, plan)
    for axis in plan.design.axes:
        for law in axis.values if axis.key == "controller.law" else ():
            prepare.check_law(setup.vary({"controller.law": law}))
    overwrite = arguments.overwrite
    finished = None if overwrite else sweep_study.finished(plan, target)
    outputs.check_output(
        target,
        overwrite or finished is not None,
        read=outputs.files_of(setup, arguments.scene, *settings),
    )
    outputs.check_writable(target.parent)  # for the journal, even if a file may be replaced
    of_results = (target.with_name(target.name + end) for end in (".json", ".partial"))
    study = _Study(plan, target, finished)
    if request.worst is not None:
        worst_latencies.check_file(study.worst_file)
    outputs.check_json(arguments.json_file, target, study.worst_file, *of_results)
    return study


def _check_not_swept(arguments: SweepArguments, plan: SweepPlan) -> None:
    """End the command if --set or --seed gives a key that differs from case to case."""
    swept = {axis.key for axis in plan.design.axes}
    for text in arguments.settings:
        if parse_setting(text)[0] in swept:
            fail(f"--set {text}: the sweep varies this key. Remove one of the two.")
    if arguments.seed is not None and "run.seed" in swept:
        fail(f"--seed = {arguments.seed}: the sweep varies run.seed. Remove one of the two.")


def _run(study: _Study) -> SweepResult:
    """Run the cases with a progress bar; end the command if they cannot be finished."""
    total, target = study.total, study.results_file
    with (
        cases_are_kept(lambda: _CAN_CONTINUE, str(target)),
        progress(f"{total} cases", total) as advance,
    ):
        return sweep_study.sweep(
            study.plan,
            target,
            on_progress=advance,
            on_wait=lambda sentence: err.say(f"{sentence}."),
        )


def _count_without_metrics(results: SweepResult) -> int:
    """Return how many cases failed, or are unstable and have no metrics."""
    return len(results.not_run) + results.unstable


def _print_results(study: _Study, results: SweepResult, request: SweepRequest) -> dict[str, Any]:
    """Print what a sweep found, and return it as plain data."""
    total, keys, rows = study.total, study.plan.design.keys, results.rows
    for line in results.damaged:
        journal = sweep_study.journal_of(study.results_file)
        err.say(f"line {line} of {journal} was damaged. Its case was run again.")
    has_metrics = _count_without_metrics(results) < total
    is_uncertain = request.uncertain is not None
    if has_metrics:
        out.print(extremes_table(rows, keys))
    if not is_uncertain:
        _print_best(study, results, request)
    if is_uncertain and has_metrics:
        out.print(quantiles_table(rows, [axis.key for axis in study.plan.design.axes]))
    phased = TOUCH_PHASE_KEY in keys and request.design == "grid" and not is_uncertain
    over_phases = grouped(rows, keys, SHOWN) if phased else []
    if over_phases:
        out.print(phases_table(over_phases, [key for key in keys if key != TOUCH_PHASE_KEY]))
    rate = results.ran / results.wall_s if results.wall_s else 0.0
    out.say(
        f"{results.ran} of {total} cases run in {results.wall_s:z.2f} s: {rate:z.0f} cases/s. "
        f"Results: {study.results_file}"
    )
    out_of_range = counted(rows, "out_of_range")
    _print_warnings(results, total, out_of_range)
    return {
        "cases": total,
        "ran": results.ran,
        "wall_s": results.wall_s,
        "cases_per_s": rate,
        "failed": len(results.not_run),
        "unstable": results.unstable,
        "unstable_loops": len(results.growing),
        "damaged_lines": results.damaged,
        "leaves_out": counted(rows, "leaves_out"),
        "out_of_range": out_of_range,
        "over_phases": [
            {key: asdict(value) if key in SHOWN else value for key, value in group.items()}
            for group in over_phases
        ],
        "results": str(study.results_file),
    }


def _print_best(study: _Study, results: SweepResult, request: SweepRequest) -> None:
    """Say whether the case with the least plate energy looks different over the other span."""
    rows = with_metric(results.rows, "plate_energy_db")
    if not rows:
        return
    best, other_span = min(rows, key=lambda row: row["plate_energy_db"]), OTHER[request.span]
    values = {key: best[key] for key in study.plan.design.keys}
    other = run_case(study.plan.setup, other_span, 0, values)
    for sentence in spans_differ(
        best["plate_energy_db"],
        other["plate_energy_db"],
        request.span,
        f"--span {other_span} sweeps the other.",
    ):
        out.say(f"At the least plate energy: {sentence}")


def _report_worst(
    arguments: SweepArguments, study: _Study, rows: Rows, metric: str
) -> dict[str, Any] | None:
    """Print the worst value of all cases, write its latencies as a trace, and return both."""
    row = worst_row(rows, metric)
    if row is None:
        out.say(f"Worst latencies: no case with jitter has a value of {metric}.")
        return None
    value, _, latencies_us = (row[name] for name in worst_columns(metric))
    keys = {key: row[key] for key in study.plan.design.keys}
    data = {
        "metric": metric,
        "value": value,
        "drawn": row[metric],
        "case": row["case"],
        "cases": sum(one[WORST_CASES] or 0 for one in rows),
        "latencies": str(study.worst_file),
    }
    where = ", ".join(f"{key.split('.')[-1]} {short(key_value)}" for key, key_value in keys.items())
    words = "unknown, as the loop is unstable" if math.isinf(value) else f"{value:.4g}"
    drawn = "unstable" if row[metric] is None else f"{row[metric]:.4g}"
    out.say(
        f"Worst latencies: {metric} is {words} at {where} (drawn: {drawn}; {data['cases']} cases). "
        "No search proves that there are no worse latencies."
    )
    phase = {TOUCH_PHASE_KEY: study.plan.setup.vary(keys).touch_phase}
    worst_latencies.write_file(
        study.worst_file,
        latencies_us,
        arguments.scene,
        arguments.settings,
        study.plan.setup.seed,
        keys | phase | {"controller.jitter_us": 0},
    )
    return data


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
