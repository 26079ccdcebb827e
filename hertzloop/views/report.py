"""A run or a recording on the terminal: verdict, metrics, warnings and the next command."""

import shlex
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from hertzloop.common.readable import argument
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.loop.run_options import LONGEST_NOTE
from hertzloop.recordings.recording import Recording, SampledStream
from hertzloop.results.assessed_run import RunReport
from hertzloop.results.inspection import Assessment, Inspected
from hertzloop.views.details import (
    error_words,
    fallback_words,
    law_line,
    missed,
    recorded_table,
    run_table,
)
from hertzloop.views.effects import OUT_OF_RANGE, neglected_lines, warning_lines
from hertzloop.views.format import Table, print_all, unwrapped
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.pacing import pacing_lines, repetition_lines
from hertzloop.views.verdict import verdict_lines, verdict_sentences

_FEW_FALLBACKS = 1e-3  # of all contact steps
Pieces = list[Text | Table]


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
    verdict = verdict_sentences(ends)
    if all(sentence.startswith(OUT_OF_RANGE) for sentence in verdict):
        has_control = ends.result.scene_law != NO_CONTROL
        verdict.append(f"The run has {'' if has_control else 'no '}control.")
    beside = [warning] if warning is not None else []
    pieces = pacing_lines(report.inspected.pacing, details) + _metrics(ends, verdict, beside)
    balance = report.balance
    if balance.newton_fallbacks > _FEW_FALLBACKS * balance.contact_steps:
        words = f"{fallback_words(balance.newton_fallbacks)}. Use a smaller run.step_ns."
        pieces.append(Text(words, "yellow"))
    if details:
        pieces += _details(ends, run_table(report))
    if report.options.verify:
        pieces.append(_verification_line(report))
    pieces += repetition_lines(report.options.repeat, report.differs)
    print_all(console, [*pieces, *_run_lines(report)])


def print_inspection(console: Console, found: Inspected, details: bool = False) -> None:
    """Print whether a recording is complete, its metrics, warnings and the next command.

    Args:
        console: Where to print.
        found: The recording, as inspected.
        details: Whether to print all tables as well.
    """
    recording, assessed = found.recording, found.assessment
    verdict = verdict_sentences(assessed) if assessed else []
    beyond = [sentence for sentence in verdict if sentence.startswith(OUT_OF_RANGE)]
    pieces: Pieces = [*verdict_lines(beyond)]
    pieces += [unwrapped(("Missing or damaged:", "red"), f" {one}") for one in found.problems]
    if found.problems:
        repair = shlex.join(["hertzloop", "repair", argument(str(recording.path))])
        pieces.append(unwrapped("A file of what is readable: ", (repair, "bold")))
    else:
        pieces.append(Text("Complete: no announced message is missing.", "bold"))
    if recording.unchecked:
        pieces.append(unwrapped(f"Not checked: {without_checksum(recording.unchecked)}."))
    pieces += pacing_lines(found.pacing, details)
    if assessed:
        pieces += _metrics(assessed, verdict[len(beyond) :])
        if assessed.predictability.why_not and not details:
            pieces.append(Text(f"Digits as recorded, since {assessed.predictability.why_not}."))
    if details:
        pieces += _streams(recording)
        facts = recorded_table(found)
        pieces += _details(assessed, facts) if assessed else [facts]
    scene = recording.metadata.get("scene", "")
    pieces.append(Text(f"Scene {scene}. Law: {law_line(found.law, digests=False)}."))
    if recording.note:
        pieces.append(_note_line(recording.note))
    print_all(console, [*pieces, *next_lines(str(recording.path))])


def _metrics(found: Assessment, verdict: list[str], beside: Sequence[Text] = ()) -> Pieces:
    """Return verdict, metrics and warnings of a run; `beside`: lines that go with the verdict."""
    metrics = found.result.metrics
    table = [metrics_table(found.result, found.rows)] if metrics.impacts else []
    return [*verdict_lines(verdict), *beside, *table, *warning_lines(metrics.neglected.checks)]


def _details(found: Assessment, facts: Table) -> Pieces:
    """Return all impacts, further metrics, properties of the run and neglected effects."""
    result, known = found.result, found.predictability
    own = "Impacts, no control" if result.scene_law == NO_CONTROL else "Impacts with control"
    metrics, free = result.metrics, found.free
    tables = [impacts_table(own, metrics.by_impact, known.controlled, known.why_not)]
    if free is not None:
        tables.append(impacts_table("The same without control", free.by_impact, known.uncontrolled))
    if metrics.noise:
        tables.append(metrics_table(result, found.rows, details=True))
    return [*tables, facts, *neglected_lines(metrics.neglected.checks)]


def _streams(recording: Recording) -> Pieces:
    """Return the table of the streams of a recording, and what it has beside."""
    table = Table("stream", right=("messages", "samples"), title=str(recording.path))
    table.add_column("fields")
    for name, stream in streams_of(recording):
        counts = (f"{stream.messages:,}", f"{stream.samples:,}")
        table.add_row(f"/{name}", *counts, ", ".join(sorted(stream.arrays)))
    table.add_row("/events", f"{len(recording.events):,}", "", "")
    others = Text(f"Ignored: {recording.others:,} messages of other topics.")
    return [table, *[others] * bool(recording.others)]


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


def _note_line(note: str) -> Text:
    """Return the note on one line, and not more of it than a run accepts."""
    shown = note[:LONGEST_NOTE].replace("\n", " ")
    return unwrapped("Note: ", shown, " ..." if len(note) > LONGEST_NOTE else "")


def without_checksum(parts: int) -> str:
    """Say how many parts have no checksum, and what that means."""
    return (
        f"{parts:,} parts of the file have no checksum, since another program wrote it. Damage in "
        "them may go unnoticed"
    )


def streams_of(recording: Recording) -> list[tuple[str, SampledStream]]:
    """Return the streams of samples of a recording, by name."""
    return [("daq", recording.daq), ("force", recording.force), ("truth", recording.truth)]
