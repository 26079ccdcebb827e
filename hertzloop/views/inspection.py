"""The contents of a recording, and the differences of two: for `inspect` and `compare`."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from hertzloop.loop.run_options import LONGEST_NOTE
from hertzloop.recordings.joined_stream import JoinedStream
from hertzloop.recordings.recording import Recording
from hertzloop.results.comparison import Comparison
from hertzloop.results.metrics import RunResult, metrics_of
from hertzloop.results.model import Yield, yield_of
from hertzloop.results.predictability import Predictability, errors_of, predictability
from hertzloop.results.recorded import (
    NEEDED_FIELDS,
    Pacing,
    RecordedLaw,
    blocks_of,
    law_of,
    pacing_of,
)
from hertzloop.results.recorded_result import recorded_result
from hertzloop.results.repeatability import why_not_repeatable
from hertzloop.results.span_metrics import SPAN_METRICS
from hertzloop.results.verdict import verdict as verdict_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.views.details import demand_words, yield_words
from hertzloop.views.effects import neglected_lines, warning_lines
from hertzloop.views.format import Table, print_all, unwrapped
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.law_line import law_line, why_not_words
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.noise_table import noise_table
from hertzloop.views.pacing import pacing_lines
from hertzloop.views.run import next_lines
from hertzloop.views.run_json import metrics_as_json, pacing_as_json, predictability_as_json
from hertzloop.views.verdict import verdict_lines, verdict_sentences


@dataclass(frozen=True)
class Inspected:
    """A recording, its problems, and its metrics.

    Attributes:
        recording: The recording.
        problems: A sentence on each missing or damaged part.
        law: Law that the forces come from.
        pacing: Missed deadlines of a paced or repeated run.
        yielded: Permanent indentation, if the contact yielded.
        result: The metrics; None if the recording has none.
        known: How many digits of the metrics are predictable; None without metrics.
        verdict: Sentences on what control changed; empty without metrics.
    """

    recording: Recording
    problems: Sequence[str]
    law: RecordedLaw
    pacing: Pacing | None
    yielded: Yield | None
    result: RunResult | None
    known: Predictability | None
    verdict: Sequence[str] = ()


def inspected(recording: Recording) -> Inspected:
    """Return the contents of a recording, with its metrics.

    A file may hold any numbers. If no metrics follow from them, that is one more problem of the
    recording, not an error of the program.
    """
    law, pacing, yielded = law_of(recording), pacing_of(recording), yield_of(recording.balance)
    bare = Inspected(recording, recording.problems, law, pacing, yielded, None, None)
    try:
        setup = parse(recording.scene_toml, recorded=True)
        problem = _contradiction(recording.truth, setup)
        if not problem:
            with np.errstate(all="ignore"):
                metrics = metrics_of(setup, blocks_of(recording))
                result = recorded_result(setup, recording, metrics, law, pacing)
                known = predictability(setup, result, None, why_not_repeatable(recording))
                verdict = verdict_sentences(verdict_of(result, known=known))
                return replace(bare, result=result, known=known, verdict=verdict)
    except (SceneError, RecursionError) as error:
        problem = f"the scene inside cannot be read: {error}{recording.other_version}"
    except (ArithmeticError, ValueError) as error:
        problem = f"no metrics follow from what was recorded: {error}"
    return replace(bare, problems=[*recording.problems, problem])


def _contradiction(truth: JoinedStream, setup: Setup) -> str:
    """Say what of the time series contradicts the scene; empty if nothing does."""
    if truth.samples and setup.step_ns != truth.step_ns:
        steps = f"{truth.step_ns} ns, those of its scene {setup.step_ns} ns"
        return f"stream 'truth' has steps of {steps}"
    lacking = NEEDED_FIELDS - set(truth.arrays)
    if truth.samples and lacking:
        return f"stream 'truth' has no {', '.join(sorted(lacking))}"
    return ""


_NO_METRICS: dict[str, Any] = {
    "impacts": [],
    "noise": [],
    "first_impact": None,
    "whole_run": None,
    "stability": None,
    "demand": None,
    "validity": [],
    "warnings": [],
    "push": None,
    "last_contact_ended": True,
    "predictability": None,
}


def summary(found: Inspected) -> dict[str, Any]:
    """Return streams, counts, problems, scene, balance and metrics as plain data."""
    recording, known = found.recording, found.known
    data: dict[str, Any] = {
        "file": str(recording.path),
        "complete": not found.problems,
        "problems": list(found.problems),
        "scene": recording.metadata.get("scene", ""),
        "seed": _number(recording, "seed"),
        "note": recording.note,
        "steps": _number(recording, "steps"),
        "streams": {
            name: {
                "messages": stream.messages,
                "samples": stream.samples,
                "first_step": stream.first_step,
                "fields": sorted(stream.arrays),
            }
            for name, stream in _streams(recording)
        },
        "other_messages": recording.others,
        "unchecked_parts": recording.unchecked,
        "events": [
            {"time_s": e.time_ns * 1e-9, "name": e.name, "message": e.message}
            for e in recording.events
        ],
        "scene_toml": recording.scene_toml,
        **asdict(found.law),
    }
    if recording.balance is not None:
        data["residuals"] = {
            "momentum": recording.balance.momentum_residual,
            "energy": recording.balance.energy_residual,
        }
        data["yield"] = asdict(found.yielded) if found.yielded else None
    data["pacing"] = pacing_as_json(found.pacing)
    if found.result is None or known is None:
        return data | _NO_METRICS | {"verdict": []}
    metrics = metrics_as_json(found.result.metrics)
    known_as_json = predictability_as_json(known)
    return data | metrics | {"predictability": known_as_json, "verdict": list(found.verdict)}


def _streams(recording: Recording) -> list[tuple[str, JoinedStream]]:
    return [("daq", recording.daq), ("force", recording.force), ("truth", recording.truth)]


def without_checksum(parts: int) -> str:
    """Say how many parts have no checksum, and what that means."""
    return (
        f"{parts:,} parts of the file have no checksum, since another program wrote it. Damage in "
        "them may go unnoticed"
    )


def _number(recording: Recording, key: str) -> int:
    """Return a number from the description of the run; 0 if there is none."""
    try:
        return int(recording.metadata.get(key, "0"))
    except ValueError:
        return 0


def show(console: Console, found: Inspected, details: bool = False) -> None:
    """Print whether a recording is complete, its metrics, warnings and the next command.

    Args:
        console: Where to print.
        found: The recording, as inspected.
        details: Whether to print all tables as well.
    """
    recording, result, known = found.recording, found.result, found.known
    pieces: list[Text | Table] = [
        unwrapped(("Missing or damaged:", "red"), f" {problem}") for problem in found.problems
    ]
    if not found.problems:
        pieces.append(Text("Complete: no announced message is missing.", "bold"))
    if recording.unchecked:
        pieces.append(unwrapped(f"Not checked: {without_checksum(recording.unchecked)}."))
    if result and known:
        pieces += verdict_lines(found.verdict, result.metrics.stability.unstable)
        if result.metrics.impacts:
            pieces.append(metrics_table(result, known))
        why_not = why_not_words(known.not_repeatable)
        if why_not and len(result.metrics.impacts) > 1 and not details:
            pieces.append(Text(f"Later impacts: digits as recorded, since {why_not}."))
        pieces += warning_lines(result.metrics.neglected.checks)
    if details:
        pieces += _details(found)
    pieces += pacing_lines(found.pacing)
    scene, seed = recording.metadata.get("scene", ""), _number(recording, "seed")
    pieces.append(Text(f"Scene {scene}, seed {seed}. Law: {law_line(found.law)}."))
    if recording.note:
        pieces.append(_note_line(recording.note))
    if recording.balance is not None:
        pieces.append(
            Text(
                f"Energy residual {recording.balance.energy_residual:.1e}, "
                f"momentum {recording.balance.momentum_residual:.1e} (relative)."
            )
        )
    print_all(console, [*pieces, *next_lines(str(recording.path))])


def _note_line(note: str) -> Text:
    """Return the note on one line, and not more of it than a run accepts."""
    shown = note[:LONGEST_NOTE].replace("\n", " ")
    return unwrapped("Note: ", shown, " ..." if len(note) > LONGEST_NOTE else "")


def _details(found: Inspected) -> list[Text | Table]:
    """Return streams, impacts, noise metrics, actuator demand, yield and neglected effects."""
    recording, known = found.recording, found.known
    scene, seed = recording.metadata.get("scene", ""), _number(recording, "seed")
    table = Table(title=f"{recording.path}: scene {scene}, seed {seed}")
    for heading in ("stream", "messages", "samples", "fields"):
        table.add_column(heading, justify="left" if heading in ("stream", "fields") else "right")
    for name, stream in _streams(recording):
        counts = (f"{stream.messages:,}", f"{stream.samples:,}")
        table.add_row(f"/{name}", *counts, ", ".join(sorted(stream.arrays)))
    table.add_row("/events", f"{len(recording.events):,}", "", "")
    pieces: list[Text | Table] = [table]
    if recording.others:
        pieces.append(Text(f"Ignored: {recording.others:,} messages of other topics."))
    metrics = found.result.metrics if found.result else None
    own, why_not = (known.controlled, why_not_words(known.not_repeatable)) if known else (None, "")
    pieces.append(impacts_table("Impacts", metrics.impacts if metrics else [], own, why_not))
    if metrics and metrics.noise:
        errors = [errors_of(own, 0, "noise_errors")]
        pieces.append(noise_table([("", metrics.noise[0])], errors=errors))
    if metrics and metrics.demand:
        pieces.append(Text(f"Actuator demand: {demand_words(metrics.demand)}."))
    if found.yielded:
        pieces.append(Text(f"Yield: {yield_words(found.yielded)}."))
    return [*pieces, *(neglected_lines(metrics.neglected.checks) if metrics else ())]


_SPANS = {"first_impact": "first impact", "whole_run": "whole run"}


def comparison_table(found: Comparison) -> Table:
    """Return the metrics of both runs with their units, and the change from A to B."""
    title = "Metrics of A and B, and the change from A to B"
    table = Table("metric", right=("A", "B", "change"), title=title)
    span = ""
    for row in found.rows:
        if row.span != span:
            span = row.span
            table.add_section()
            table.add_row(Text(_SPANS[span], style="bold"), "", "", "")
        of = SPAN_METRICS[row.metric]
        values = [
            "not defined" if math.isnan(value) else f"{value * of.factor:.4g} {of.unit}".strip()
            for value in (row.a, row.b)
        ]
        change = f"{row.b_to_a:+z.2f} {row.unit}" if row.unit else f"{row.b_to_a:+z.0f}"
        table.add_row(of.words, *values, "" if math.isnan(row.b_to_a) else change)
    return table


class PrintedComparison(Comparison):
    """A comparison that prints as its table."""

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(comparison_table(self))
        return caught.get()
