"""The contents of a recording on the terminal."""

from rich.console import Console
from rich.text import Text

from hertzloop.loop.run_options import LONGEST_NOTE
from hertzloop.recordings.recording import Recording, SampledStream
from hertzloop.results.inspection import Inspected
from hertzloop.views.details import recorded_table
from hertzloop.views.effects import OUT_OF_RANGE, neglected_lines, warning_lines
from hertzloop.views.format import Table, print_all, unwrapped
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.law_line import law_line
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.pacing import pacing_lines
from hertzloop.views.run import next_lines
from hertzloop.views.verdict import verdict_lines, verdict_sentences


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
    pieces: list[Text | Table] = [*verdict_lines(beyond)]
    pieces += [unwrapped(("Missing or damaged:", "red"), f" {one}") for one in found.problems]
    if not found.problems:
        pieces.append(Text("Complete: no announced message is missing.", "bold"))
    if recording.unchecked:
        pieces.append(unwrapped(f"Not checked: {without_checksum(recording.unchecked)}."))
    pieces += pacing_lines(found.pacing, details)
    if assessed:
        result, known = assessed.result, assessed.predictability
        pieces += verdict_lines(verdict[len(beyond) :])
        if result.metrics.impacts:
            pieces.append(metrics_table(result, assessed.rows))
        if known.why_not and not details:
            pieces.append(Text(f"Digits as recorded, since {known.why_not}."))
        pieces += warning_lines(result.metrics.neglected.checks)
    if details:
        pieces += _details(found)
    scene = recording.metadata.get("scene", "")
    pieces.append(Text(f"Scene {scene}. Law: {law_line(found.law, digests=False)}."))
    if recording.note:
        pieces.append(_note_line(recording.note))
    print_all(console, [*pieces, *next_lines(str(recording.path))])


def _details(found: Inspected) -> list[Text | Table]:
    """Return streams, impacts, further metrics, facts of the run and neglected effects."""
    recording, assessed = found.recording, found.assessment
    table = Table("stream", right=("messages", "samples"), title=str(recording.path))
    table.add_column("fields")
    for name, stream in streams_of(recording):
        counts = (f"{stream.messages:,}", f"{stream.samples:,}")
        table.add_row(f"/{name}", *counts, ", ".join(sorted(stream.arrays)))
    table.add_row("/events", f"{len(recording.events):,}", "", "")
    pieces: list[Text | Table] = [table]
    if recording.others:
        pieces.append(Text(f"Ignored: {recording.others:,} messages of other topics."))
    if assessed is None:
        return [*pieces, impacts_table("Impacts", []), recorded_table(found)]
    metrics, known = assessed.result.metrics, assessed.predictability
    pieces.append(impacts_table("Impacts", metrics.by_impact, known.controlled, known.why_not))
    if metrics.noise:
        pieces.append(metrics_table(assessed.result, assessed.rows, details=True))
    return [*pieces, recorded_table(found), *neglected_lines(metrics.neglected.checks)]


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
