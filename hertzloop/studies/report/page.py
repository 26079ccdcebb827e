"""One self-contained HTML page of a run."""

import base64
import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.listening import write_sounds
from hertzloop.results.metrics import free_metrics
from hertzloop.results.recorded import law_of
from hertzloop.results.repeatability import why_not_repeatable
from hertzloop.results.verdict import RunAssessment, assess_recording
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import binding_mode, mode_line
from hertzloop.studies.margin.chart import draw
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.jitter import at_shortest_latency, jitter_margin_of
from hertzloop.studies.margin.sentences import jitter_lines, margin_lines
from hertzloop.studies.pages.html import ResultTable, template
from hertzloop.studies.report.animation import animation_of
from hertzloop.studies.report.charts import around_first_contact, spectra, whole_run
from hertzloop.studies.report.repetition import repetition
from hertzloop.views.effects import sentences_of
from hertzloop.views.impacts_table import impact_headings, impact_rows
from hertzloop.views.law_line import law_line, why_not_words
from hertzloop.views.metrics_table import cells_of, further_rows, notes_on, shown_rows
from hertzloop.views.provenance import text_of_law
from hertzloop.views.replaying import prepare, scene_of
from hertzloop.views.verdict import verdict_sentences


def page_of(recording: Recording) -> str:
    """The page. Raises RecordingError if the recording cannot be read or replayed."""
    setup, shown = scene_of(recording), prepare(recording, drawn="Dashed")
    without = free_metrics(setup) if shown.labels.reference is not None else None
    found = assess_recording(setup, recording, without, why_not_repeatable(recording))
    metrics, verdict = found.result.metrics, found.assessment
    unstable = metrics.stability.unstable
    sounds, silent = _sounds(recording, setup)
    law, law_text, lawless = _law(recording)
    again, commands = repetition(recording, setup, bool(law_text))
    margin, margin_png = _margin(recording, setup)
    return template("run.html.j2").render(
        title=shown.labels.heading,
        lines=[line.replace("**", "") for line in shown.labels.lines],
        problems=recording.problems,
        unstable=unstable,
        verdict=verdict_sentences(verdict),
        neglected=sentences_of(metrics.neglected.checks),
        margin=margin,
        margin_png=margin_png,
        tables=_tables(found, not unstable),
        around=around_first_contact(shown) if shown.contacts else "",
        whole=whole_run(shown),
        spectra=spectra(shown) if shown.labels.spectra else "",
        flat="" if shown.deflection.known else "The mode file has no shapes: drawn flat.",
        animation=json.dumps(animation_of(shown)),
        sounds=sounds,
        silent=silent,
        scene=recording.scene_toml,
        law=law,
        law_text=law_text,
        lawless=lawless,
        again=again,
        commands=commands,
        versions=_versions(recording),
    )


def _tables(found: RunAssessment, compare: bool) -> list[ResultTable]:
    """Metrics of the first impact and all impacts as `run` prints them, those without
    control, too; none where a run has no impact."""
    runs = [found.result.metrics, *([found.free] if found.free else [])]
    if not all(run.noise for run in runs):
        return []
    known, ends = found.assessment.predictability, found.assessment
    digits = [known.controlled, known.uncontrolled][: len(runs)]
    names = ["with control", "without"] if found.free else ["this run"]
    compare = compare and found.free is not None
    shown = [*shown_rows(ends.rows), *further_rows(ends.rows)]
    columns = ["metric of the first impact", *names, *(["change"] if compare else [])]
    rows = [cells_of(row, ends.result.complete, compare) for row in shown]
    tables = [ResultTable("", columns, rows, "; ".join(notes_on(shown)))]
    for name, run, each in zip(names, runs, digits, strict=True):
        why_not = why_not_words(known.not_repeatable) if run is runs[0] else ""
        rows, notes = impact_rows(run.impacts, each, why_not)
        numbered = [[str(i), *row] for i, row in enumerate(rows, 1)]
        headings = [f"impacts, {name}", *impact_headings(run.impacts)]
        tables.append(ResultTable("", headings, numbered, "; ".join(notes)))
    return tables


def _law(recording: Recording) -> tuple[str, str, str]:
    result = law_line(law_of(recording))
    try:
        return result, text_of_law(recording), ""
    except RecordingError as error:
        return result, "", str(error)


def _margin(recording: Recording, setup: Setup) -> tuple[list[str], str]:
    """What linear theory says about the loop, in sentences, and its picture as base64 of a PNG.

    Empty without a linear loop, and for laws that are not shipped: a report runs no user's code.
    """
    if law_of(recording).law not in shipped_laws() or not law_of(recording).as_announced:
        return [], ""
    try:
        constant = at_shortest_latency(setup)
        found = margin_of(constant)
        if not found.applicable:
            return [], ""
        lines = margin_lines(found) + jitter_lines(jitter_margin_of(setup, found))
        at_hz = found.binding_frequency_hz
        if at_hz is not None:
            lines.append(mode_line(binding_mode(constant, at_hz), at_hz))
        png = io.BytesIO()
        draw(constant, found).savefig(png, format="png", dpi=90)
    except SceneError as error:
        return [f"No margin: {error}"], ""
    return lines, base64.b64encode(png.getvalue()).decode()


def _sounds(recording: Recording, setup: Setup) -> tuple[list[dict[str, str]], str]:
    """Sounds at 1 m, their data as base64 of a WAV file, or why there are none."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        try:
            heard = write_sounds(recording, setup, Path(folder), (0.0, 0.0, 1.0), 1.0, 0.3)
        except (RecordingError, SceneError) as error:
            return [], str(error)
        return [
            {
                "label": name.replace("-", " "),
                "level": f"{run['level_db']:z.1f} dB sound exposure level",
                "data": base64.b64encode(Path(run["file"]).read_bytes()).decode(),
            }
            for name, run in heard["runs"].items()
        ], ""


def _versions(recording: Recording) -> list[tuple[str, str]]:
    try:
        found = json.loads(recording.metadata.get("versions", "{}"))
    except json.JSONDecodeError:
        return []
    return [(str(name), str(number)) for name, number in dict(found).items()]
