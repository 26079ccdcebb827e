"""The end of a run on the terminal: verdict, metrics, warnings and the next command."""

import shlex

from rich.console import Console
from rich.text import Text

from hertzloop.common.readable import argument
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.assessed_run import RunReport
from hertzloop.views.details import error_words, fallback_words, missed, run_table
from hertzloop.views.effects import OUT_OF_RANGE, neglected_lines, warning_lines
from hertzloop.views.format import Table, print_all, unwrapped
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.law_line import law_line
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.pacing import pacing_lines, repetition_lines
from hertzloop.views.verdict import verdict_lines, verdict_sentences

_FEW_FALLBACKS = 1e-3  # of all contact steps


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
    ends = report.assessment
    result, verdict = ends.result, verdict_sentences(ends)
    controlled = result.scene_law != NO_CONTROL
    pieces: list[Text | Table] = list(pacing_lines(report.inspected.pacing, details))
    pieces += verdict_lines(verdict)
    if all(sentence.startswith(OUT_OF_RANGE) for sentence in verdict):
        pieces.append(Text(f"The run has {'' if controlled else 'no '}control.", "bold"))
    pieces.append(metrics_table(result, ends.rows))
    pieces += warning_lines(result.metrics.neglected.checks)
    if warning is not None:
        pieces.append(warning)
    balance = report.balance
    if balance.newton_fallbacks > _FEW_FALLBACKS * balance.contact_steps:
        pieces.append(
            Text(
                f"{fallback_words(balance.newton_fallbacks)}. Use a smaller run.step_ns.", "yellow"
            )
        )
    if details:
        pieces += _details(report)
    if report.options.verify:
        pieces.append(_verification_line(report))
    pieces += repetition_lines(report.options.repeat, report.differs)
    print_all(console, [*pieces, *_run_lines(report)])


def next_lines(path: str) -> list[Text]:
    """Return the path of the recording and the next command."""
    return [
        unwrapped("Recording: ", (path, "bold"), ". --details prints all metrics."),
        unwrapped("Next: ", (shlex.join(["hertzloop", "replay", argument(path)]), "bold")),
    ]


def _verification_line(report: RunReport) -> Text:
    """Say what half the step and twice the modes changed."""
    found, asked = report.verification, report.setup.run.accuracy
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
    """Return scene, law, error of the model, recording and the next command."""
    setup, infinite = report.setup, report.setup.plant.infinite_plate
    return [
        Text(
            f"Scene {setup.scene.name}, {setup.run.steps:,} steps in "
            f"{report.stats['wall_s']:.3g} s. Law: {law_line(report.inspected.law, digests=False)}."
        ),
        Text.assemble(
            f"Error of the {'missing reflections' if infinite else 'truncated modes'} "
            f"{error_words(*report.expects)} (requested {report.setup.run.accuracy:g}",
            ("; missed", "yellow") if missed(*report.expects) else "",
            ").",
        ),
        *next_lines(str(report.inspected.recording.path)),
    ]


def _details(report: RunReport) -> list[Text | Table]:
    """Return all impacts, further metrics, properties of the run and neglected effects."""
    ends = report.assessment
    result, known = ends.result, ends.predictability
    found, free = result.metrics, ends.free
    if result.scene_law == NO_CONTROL or free is None:
        tables = [impacts_table("Impacts, no control", found.by_impact, known.controlled)]
    else:
        tables = [
            impacts_table("Impacts with control", found.by_impact, known.controlled),
            impacts_table("The same without control", free.by_impact, known.uncontrolled),
        ]
    if found.noise:
        tables.append(metrics_table(result, ends.rows, details=True))
    return [*tables, run_table(report), *neglected_lines(found.neglected.checks)]
