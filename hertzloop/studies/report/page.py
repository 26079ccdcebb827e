"""One self-contained HTML page of a run: verdict, tables, charts and scene."""

import shlex
from collections.abc import Sequence
from typing import NamedTuple

import jinja2

from hertzloop.common.readable import argument
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.inspection import Assessment, inspected
from hertzloop.results.metrics import Metrics
from hertzloop.results.recorded import law_of, setup_of
from hertzloop.studies.report.charts import charts_of
from hertzloop.views.details import law_line
from hertzloop.views.effects import sentences_of
from hertzloop.views.impacts_table import impact_headings, impact_rows
from hertzloop.views.metrics_table import cells_of, further_rows, notes_on, shown_rows
from hertzloop.views.provenance import text_of_law
from hertzloop.views.replaying import prepare
from hertzloop.views.verdict import verdict_sentences


class _Table(NamedTuple):
    """A table of the page; `words`: notes above it."""

    title: str
    headings: Sequence[str]
    rows: list[list[str]]
    words: str


def page_of(recording: Recording) -> str:
    """Return the page of a run as HTML, which needs no other file.

    Raises:
        RecordingError: The recording cannot be read or replayed.
        SceneError: Its scene cannot be simulated.
    """
    setup, shown = setup_of(recording), prepare(recording, drawn="Dashed", verdict=False)
    found = inspected(recording, shown.labels.reference is not None, setup)
    ends = found.assessment
    if ends is None:
        raise RecordingError(f"{recording.path}: {found.problems[-1]}")
    metrics, verdict = ends.result.metrics, verdict_sentences(ends)
    unstable, law = metrics.stability.unstable, law_of(recording)
    effects = sentences_of(metrics.neglected.checks)
    texts = [(setup.scene.name, recording.scene_toml)]
    try:
        texts.append((f"{law.law} (law)", text_of_law(recording)))
        no_text = []
    except RecordingError as error:
        no_text = [f"{error}."]
    template = jinja2.Environment(
        loader=jinja2.PackageLoader("hertzloop.studies.report", ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    ).get_template("page.html.j2")
    return template.render(
        title=shown.labels.heading,
        lines=[
            *([] if unstable else verdict),
            *(line.replace("**", "") for line in shown.labels.lines),
            *(f"{head} {words}" for head, words in effects if not head.isupper()),
            f"Law: {law_line(law)}.",
            *no_text,
        ],
        charts=charts_of(shown),
        tables=_tables(ends, ends.free, not unstable),
        commands=_commands(recording) if law.as_announced else [],
        versions=recording.metadata.get("versions", ""),
        scenes=texts,
        warnings=[
            *recording.problems,
            *(f"{head} {words}" for head, words in effects if head.isupper()),
            *(verdict if unstable else []),
        ],
    )


def _commands(recording: Recording) -> list[str]:
    """Return the commands that give the same samples again."""
    file = argument(recording.path.name)
    again = argument(f"{recording.path.stem}-again.mcap")
    words = [["run", "--repeat", file, "--out", again], ["compare", again, file]]
    return [shlex.join(["hertzloop", *command]) for command in words]


def _tables(ends: Assessment, free: Metrics | None, compare: bool) -> list[_Table]:
    """Return metrics of the first impact and all impacts as `run` prints them, those without
    control, too; none where a run has no impact."""
    runs = [ends.result.metrics, *([free] if free else [])]
    if not all(run.noise for run in runs):
        return []
    known = ends.predictability
    digits = [known.controlled, known.uncontrolled][: len(runs)]
    names = ["with control", "without"] if free else ["this run"]
    compare = compare and free is not None
    shown = [*shown_rows(ends.rows), *further_rows(ends.rows)]
    columns = ["metric", *names, *(["change"] if compare else [])]
    rows = [cells_of(row, ends.result.complete, compare) for row in shown]
    tables = [_Table("First impact", columns, rows, "; ".join(notes_on(shown)))]
    for name, run, each in zip(names, runs, digits, strict=True):
        why_not = known.why_not if run is runs[0] else ""
        rows, notes = impact_rows(run.by_impact, each, why_not)
        numbered = [[str(i), *row] for i, row in enumerate(rows, 1)]
        headings = ["impact", *impact_headings(run.by_impact)]
        tables.append(_Table(f"Impacts, {name}", headings, numbered, "; ".join(notes)))
    return tables
