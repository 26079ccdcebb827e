"""The command `budget`."""

import shlex
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hertzloop.cli import options, outputs, prepare, worst_latencies
from hertzloop.cli.budget_text import (
    effect_lines,
    print_budget,
    print_probability,
    probability_line,
    trace_line,
    worst_line,
)
from hertzloop.cli.many_cases import resumable
from hertzloop.cli.requirements import check_requirements
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.cli.worst_latencies import run_command
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.plant_checks import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget import budget as budget_study
from hertzloop.studies.budget.goal import DEFAULT_GOAL, Goal, parse_goal
from hertzloop.studies.budget.limits import NAMES
from hertzloop.studies.budget.probability import (
    Probability,
    Sensitivity,
    probability,
    sensitivities,
)
from hertzloop.studies.requests import BudgetRequest
from hertzloop.studies.sweeps.design import Design
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.sweeps.sweep import work_of
from hertzloop.studies.sweeps.uncertain import UncertainInputs, read_uncertain
from hertzloop.warmup import CASES

if TYPE_CHECKING:
    from hertzloop.studies.budget.budget import Budget
    from hertzloop.studies.budget.page import Map

GoalOption = Annotated[
    list[str] | None,
    typer.Option(
        "--goal",
        help="Condition that the law must meet at every touch phase, e.g. 'plate_energy_db <= -3'. "
        "May be given several times. Default: plate_energy_db <= -0.1.",
    ),
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Search coarsely, with a thin plate as the real one.")
]
OnlyOption = Annotated[
    list[str] | None,
    typer.Option(help="Quantity to search, e.g. latency_us. May be given several times."),
]
RealPlantOption = Annotated[
    bool, typer.Option("--real-plant/--no-real-plant", help="Search in the real plant too.")
]
BudgetSpanOption = Annotated[
    Literal["impact", "run", "both"],
    typer.Option(help="Take metrics of the first impact, or of the whole run, or of each."),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Number of processes; all cores if not given.")
]
WithinOption = Annotated[
    float,
    typer.Option(min=1e-4, max=0.5, help="Half the width at which the interval is narrow enough."),
]
MostCasesOption = Annotated[
    int, typer.Option(min=16, max=1_000_000, help="Stop drawing after this many cases.")
]
SobolOption = Annotated[
    int,
    typer.Option(min=0, help="Base points for Sobol indices, a power of 2; 0 for none."),
]
WorstOption = Annotated[
    bool,
    typer.Option(
        "--worst",
        help="Search the sequence of latencies within the jitter that makes the goal fail soonest.",
    ),
]
LawOption = Annotated[
    str | None, typer.Option(help="Law: a shipped name or a file; the scene's if not given.")
]
TraceOption = Annotated[
    Path | None,
    typer.Option(
        help="Latencies by sample in place of controller.latency_us: a CSV file, or a recording of "
        "a paced run (.mcap)."
    ),
]
UncertainOption = Annotated[
    Path | None,
    typer.Option(
        "--uncertain",
        help="Compute the probability of the goal for the distributions in this TOML file, or in "
        "the tables \\[uncertain] and \\[fit] of this scene.",
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
    """What `hertzloop budget` was called with.

    Attributes:
        request: What to search, and how finely.
        scene: Name of the scene.
        settings: Changes of its keys, those of --law and --trace included.
        seed: Random seed; None: that of the scene.
        uncertain_file: Distributions of uncertain keys, if the probability is asked for.
        folder: Folder for a page, if one is asked for.
    """

    request: BudgetRequest
    scene: str
    settings: list[str]
    seed: int | None
    uncertain_file: Path | None
    folder: Path | None


def budget(
    goals: GoalOption = None,
    quick: QuickOption = False,
    only: OnlyOption = None,
    with_real: RealPlantOption = True,
    span: BudgetSpanOption = "impact",
    workers: WorkersOption = None,
    within: WithinOption = BudgetRequest.within,
    most_cases: MostCasesOption = BudgetRequest.most_cases,
    sobol: SobolOption = 0,
    worst: WorstOption = False,
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
    request = BudgetRequest(
        goals or (), quick, only or (), with_real, span, workers, within, most_cases, sobol, worst
    )
    outputs.check_json(json_file)
    outputs.check_folder(junit_file)
    if requirements is not None:
        check_requirements(requirements, workers, junit_file, json_file)
        return
    if junit_file is not None:
        fail("--junit needs --check. Name a file of requirements")
    changes = _changes(settings or [], law, trace)
    arguments = BudgetArguments(request, scene, changes, seed, uncertain_file, folder)
    study = _checked(arguments)
    outputs.make_folder(folder or Path())  # for unfinished work, too
    prepare.compile_first(study.setup, works=CASES)
    began_s = time.perf_counter()
    result = _run(arguments, study)
    data = _print_result(arguments, study, result)
    out.print(f"{result.cases} cases in {time.perf_counter() - began_s:z.1f} s")
    if folder is not None:
        _write_page(folder, arguments, study, result)
    outputs.write_json(json_file, data)


def _changes(settings: list[str], law: str | None, trace: Path | None) -> list[str]:
    """Return all changes of scene keys: those of --set, --law and --trace."""
    changes = list(settings)
    if law is not None:
        changes.append(f"controller.law={law}")
    if trace is not None:
        changes += ["controller.latency_us=0", f"controller.latency_trace={trace}"]
    return changes


@dataclass(frozen=True)
class BudgetStudy:
    """What to search after all checks: a scene with a law, goals, and uncertain keys, if any."""

    setup: Setup
    goals: list[Goal]
    uncertain: UncertainInputs | None


def _checked(arguments: BudgetArguments) -> BudgetStudy:
    """Return what to search; end the command for what cannot be searched."""
    request = arguments.request
    setup = prepare.scene_from(arguments.scene, arguments.settings, arguments.seed)
    check_conserves(setup.scheme)
    goals = [parse_goal(text) for text in request.goals or [DEFAULT_GOAL]]
    if not setup.has_law:
        raise SceneError(
            "controller.law = 'off': has no limits. Name a law, for example --law slope_threshold"
        )
    for name in request.only:
        if name not in NAMES:
            raise SceneError(
                f"--only = '{name}': is not a quantity. Choose from {', '.join(NAMES)}"
            )
    if request.worst:
        _check_worst(request, setup)
        worst_latencies.check_file(_worst_file(arguments, setup.name))
    file = arguments.uncertain_file
    uncertain = read_uncertain(file, setup) if file else None
    sobol = request.sobol
    if sobol and not uncertain:
        raise SceneError("--sobol needs --uncertain. Name a file of distributions")
    if sobol & (sobol - 1):
        raise SceneError(f"--sobol = {sobol}: must be a power of 2, for example 256")
    if sobol:
        need("SALib")
    if arguments.folder is not None:
        need("matplotlib", "jinja2")
    return BudgetStudy(setup, goals, uncertain)


def _check_worst(request: BudgetRequest, setup: Setup) -> None:
    """End the command if the worst sequence cannot be searched in a scene."""
    control = setup.scene.controller
    if request.only and "jitter_us" not in request.only:
        raise SceneError("--worst needs the limit of jitter. Add --only jitter_us")
    own = control.jitter_us, control.clock_ppm, control.drop_out_probability
    if control.latency_trace is not None or any(own):
        raise SceneError(
            "--worst: searches all sequences of latencies, but the scene has latencies of its own. "
            "Leave out controller.latency_trace, jitter_us, clock_ppm and drop_out_probability"
        )


@dataclass(frozen=True)
class BudgetResult:
    """What was found.

    Attributes:
        budget: The limits of every quantity.
        limit_map: Map of the two tightest quantities, for the page.
        probability: Probability that the goals are met with uncertain keys.
        indices: Sobol indices of the uncertain keys.
        cases: Number of cases that this took.
    """

    budget: "Budget"
    limit_map: "Map | None"
    probability: Probability | None
    indices: list[Sensitivity]
    cases: int


def _run(arguments: BudgetArguments, study: BudgetStudy) -> BudgetResult:
    """Run all cases; those that an earlier start has finished are not run again."""
    request, setup, goals = arguments.request, study.setup, study.goals
    folder, span = arguments.folder, request.first_span
    searched = [request.span, request.quick, request.with_real, request.worst, *request.only]
    header = {
        **work_of([setup], [setup.law_reference], Design(())),
        "budget": [*map(str, goals), *searched],
    }
    with (
        resumable(folder or Path(), "budget", header) as finished,
        progress("budget", 1000) as advance,
        local_pool(request.workers) as workers,
    ):
        pool = finished.of(workers)
        budget = budget_study.budget(
            pool, setup, goals, request, lambda share: advance(round(1000 * share))
        )
        cases = budget.cases
        limit_map = likely = None
        indices: list[Sensitivity] = []
        if folder is not None:
            from hertzloop.studies.budget.page import map_of  # of an extra

            limit_map = map_of(pool, setup, goals, span, budget.ideal, request.quick)
        uncertain, base = study.uncertain, request.sobol
        if uncertain:
            within, most = request.within, request.most_cases
            likely = probability(pool, setup, goals, uncertain, span, within=within, most=most)
            cases += likely.cases
            if base:
                indices = sensitivities(pool, setup, goals, uncertain, span, base)
                cases += base * (len(uncertain.parts) + 2)
    return BudgetResult(budget, limit_map, likely, indices, cases)


def _print_result(
    arguments: BudgetArguments, study: BudgetStudy, result: BudgetResult
) -> dict[str, Any]:
    """Print what was found, and return it as plain data."""
    latencies_us = study.setup.scene.controller.latency_trace
    if latencies_us:
        out.print(trace_line(latencies_us))
    print_budget(result.budget)
    data = budget_study.as_data(result.budget)
    if result.budget.worst is not None:
        _report_worst(arguments, result.budget, study.setup.seed)
    likely = result.probability
    if likely:
        command = run_command(arguments.scene, arguments.settings, study.setup.seed, likely.worst)
        print_probability(likely, result.indices, command)
        data["probability"] = {
            **{key: value for key, value in asdict(likely).items() if key != "drawn"},
            "worst_command": command,
            "drawn": list(likely.drawn),
            "sobol": [asdict(index) for index in result.indices],
        }
    return data


def _report_worst(arguments: BudgetArguments, found: "Budget", seed: int) -> None:
    """Print the limit of jitter against the worst sequence, and write the sequence as a trace."""
    limit = found.worst
    assert limit is not None
    out.say(worst_line(found))
    if limit.worst is None:
        return
    path = _worst_file(arguments, found.scene)
    case = {"run.touch_phase": limit.worst.touch_phase}
    scene, settings = arguments.scene, arguments.settings
    worst_latencies.write_file(path, limit.worst.latencies_us, scene, settings, seed, case)


def _worst_file(arguments: BudgetArguments, scene: str) -> Path:
    """Return the file that takes the worst latencies of a scene."""
    return (arguments.folder or Path()) / f"{scene}-worst-latencies.csv"


def _write_page(
    folder: Path, arguments: BudgetArguments, study: BudgetStudy, result: BudgetResult
) -> None:
    """Write what was found as a page, with the command that finds it again."""
    from hertzloop.studies.budget.page import write_page  # of an extra

    lines = effect_lines(result.budget)
    if result.probability:
        lines.append(probability_line(result.probability))
    words = ["hertzloop", "budget", arguments.scene]
    words += [word for change in arguments.settings for word in ("--set", change)]
    words += [word for goal in study.goals for word in ("--goal", str(goal))]
    words += ["--quick"] if arguments.request.quick else []
    command = shlex.join([*words, "--out-dir", str(folder)])
    page = write_page(folder, study.setup, result.budget, result.limit_map, lines, command)
    out.say(f"written: {page}")
