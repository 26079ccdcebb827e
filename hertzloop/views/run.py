"""The end of a run on the terminal: verdict, metrics, warnings and the next command."""

import shlex

from rich.console import Console
from rich.text import Text

from hertzloop.common.readable import argument
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.predictability import errors_of
from hertzloop.results.run_report import RunReport
from hertzloop.views.details import error_words, missed, run_table
from hertzloop.views.effects import neglected_lines, warning_lines
from hertzloop.views.format import Table, print_all, unwrapped
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.law_line import law_line
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.noise_table import noise_table
from hertzloop.views.pacing import pacing_lines
from hertzloop.views.verdict import verdict_lines, verdict_sentences


def print_run(
    console: Console, report: RunReport, details: bool = False, warning: Text | None = None
) -> None:
    """Print the end of a run: verdict, metrics, warnings and the next command.

    Args:
        console: Where to print.
        report: The run.
        details: Whether to print all tables as well.
        warning: One more warning, on what is not in the recording.
    """
    assessed, ends = report.assessed, report.assessed.assessment
    result, verdict = assessed.result, verdict_sentences(ends)
    controlled = result.scene_law != NO_CONTROL
    pieces: list[Text | Table] = []
    if not verdict:
        pieces.append(Text(f"The run has {'' if controlled else 'no '}control.", "bold"))
    pieces += verdict_lines(verdict, result.metrics.stability.unstable)
    free = (assessed.free or result.metrics) if controlled else None
    pieces.append(metrics_table(result, ends.predictability, free))
    pieces += warning_lines(result.metrics.neglected.checks)
    if warning is not None:
        pieces.append(warning)
    if details:
        pieces += _details(report)
    if report.verifies:
        pieces.append(_verification_line(report))
    pieces += pacing_lines(assessed.pacing, report.repeats, report.differs)
    print_all(console, [*pieces, *_run_lines(report)])


def next_lines(path: str) -> list[Text]:
    """Return the path of the recording and the next command."""
    return [
        unwrapped("Recording: ", (path, "bold"), ". --details prints all metrics."),
        unwrapped("Next: ", (shlex.join(["hertzloop", "replay", argument(path)]), "bold")),
    ]


def _verification_line(report: RunReport) -> Text:
    """Say what half the step and twice the modes changed."""
    found, asked = report.verification, report.assessed.requested_accuracy
    if found is None:
        return unwrapped("Nothing to verify: no impact ends within the run.")
    met = ("met", "") if found.largest <= asked else ("missed", "red")
    modes = f"and modes to {found.frequency_limit_hz / 1e3:.4g} kHz"
    if report.setup.plant.plate.mode_table is not None:
        modes = "alone, as the file has no more modes"
    return unwrapped(
        f"Verified with half the step {modes}: "
        f"penetration {found.penetration:.1e}, rebound speed {found.rebound_speed:.1e}, "
        f"plate energy {found.plate_energy:.1e}; requested {asked:g}: ",
        met,
        ".",
    )


def _run_lines(report: RunReport) -> list[Text]:
    """Return scene, law, errors, recording and the next command."""
    setup, balance, path = report.setup, report.balance, str(report.recording.path)
    return [
        Text(
            f"Scene {setup.name}, seed {setup.seed}, {report.transport}, "
            f"{setup.steps:,} steps in {report.wall_s:.3g} s. "
            f"Law: {law_line(report.assessed.law)}."
        ),
        Text.assemble(
            f"Model error {error_words(*report.expects)} "
            f"(requested {report.assessed.requested_accuracy:g}",
            ("; missed", "yellow") if missed(*report.expects) else "",
            f"). Energy residual {balance.energy_residual:.1e}, "
            f"momentum {balance.momentum_residual:.1e}.",
        ),
        *next_lines(path),
    ]


def _details(report: RunReport) -> list[Text | Table]:
    """Return all impacts, noise metrics, properties of the run and neglected effects."""
    result, known = report.assessed.result, report.assessed.assessment.predictability
    found, free = result.metrics, report.assessed.free or result.metrics
    own, other = known.controlled, known.uncontrolled
    errors = [errors_of(each, 0, "noise_errors") for each in (own, other)]
    if result.scene_law != NO_CONTROL:
        tables = [
            impacts_table("Impacts with control", found.impacts, own),
            impacts_table("The same without control", free.impacts, other),
        ]
        if found.noise and free.noise:
            cases = [("with control", found.noise[0]), ("without", free.noise[0])]
            tables.append(noise_table(cases, not found.stability.unstable, errors))
    else:
        tables = [impacts_table("Impacts, no control", found.impacts, own)]
        if found.noise:
            tables.append(noise_table([("no control", found.noise[0])], errors=errors[:1]))
    return [*tables, run_table(report), *neglected_lines(found.neglected.checks)]
