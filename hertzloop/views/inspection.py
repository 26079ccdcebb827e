"""What a recording holds, and how two differ: for `hertzloop inspect` and `compare`."""

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from hertzloop.analysis.figures import Ran, figures_of
from hertzloop.analysis.meters import SPAN_ROWS, Comparison, Difference
from hertzloop.analysis.model import yield_of
from hertzloop.analysis.recorded import NEEDED_FIELDS, blocks_of, law_of, pacing_of
from hertzloop.analysis.trust import errors_of, predictability, why_not_again
from hertzloop.analysis.verdict import saturation_of, verdict
from hertzloop.recordings.reader import Recording
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import parse
from hertzloop.views.format import Table, styled
from hertzloop.views.run import (
    demand_words,
    figures_as_json,
    figures_table,
    impacts_table,
    known_in,
    law_in,
    law_line,
    noise_table,
    pacing_as_json,
    predictability_as_json,
    show_neglected,
    show_pacing,
    show_verdict,
    show_warnings,
    verdict_sentences,
    yield_words,
)


def summary(recording: Recording) -> dict[str, Any]:
    """Streams, counts, problems, scene, books and impacts as plain data."""
    streams = {
        name: {
            "messages": stream.messages,
            "samples": stream.samples,
            "first_step": stream.first_step,
            "fields": sorted(stream.arrays),
        }
        for name, stream in (
            ("daq", recording.daq), ("force", recording.force), ("truth", recording.truth)
        )
    }  # fmt: skip
    data: dict[str, Any] = {
        "file": str(recording.path),
        "complete": not recording.problems,
        "problems": recording.problems,
        "scene": recording.metadata.get("scene", ""),
        "seed": _number(recording, "seed"),
        "steps": _number(recording, "steps"),
        "streams": streams,
        "other_messages": recording.others,
        "unchecked_parts": recording.unchecked,
        "events": [
            {"time_s": e.time_ns * 1e-9, "name": e.name, "message": e.message}
            for e in recording.events
        ],
        "scene_toml": recording.scene_toml,
        **asdict(law_of(recording)),
    }
    if recording.books is not None:
        data["residuals"] = {
            "momentum": recording.books.momentum_residual,
            "energy": recording.books.energy_residual,
        }
        found = yield_of(recording.books)
        data["yield"] = asdict(found) if found else None
    pacing = pacing_of(recording)
    data["pacing"] = pacing_as_json(pacing)
    figures, problem = _figures(recording, late=pacing is not None)
    data |= figures
    if problem:
        data["problems"] = [*recording.problems, problem]
        data["complete"] = False
    return data


def without_checksum(parts: int) -> str:
    """What it means that another program left checksums out."""
    return (
        f"{parts:,} parts of the file have no checksum, since another program wrote it. Damage in "
        "them may go unnoticed"
    )


def _number(recording: Recording, key: str) -> int:
    """A number of the run's description, 0 where there is none."""
    try:
        return int(recording.metadata.get(key, "0"))
    except ValueError:
        return 0


def _figures(recording: Recording, late: bool) -> tuple[dict[str, Any], str]:
    """Impacts, noise, stability and demand, and why there are none. What a file says of itself may
    be anything: numbers that no figures follow from are one more thing wrong with it, not with us.
    """
    nothing: dict[str, Any] = {"impacts": [], "noise": [], "first_impact": None,
                               "whole_run": None, "stability": None, "demand": None,
                               "validity": [], "warnings": [], "push": None,
                               "last_contact_ended": True, "predictability": None,
                               "verdict": []}  # fmt: skip
    truth = recording.truth
    try:
        setup = parse(recording.scene_toml, recorded=True)
        if truth.samples and setup.step_ns != truth.step_ns:
            steps = f"{truth.step_ns} ns, those of its scene {setup.step_ns} ns"
            return nothing, f"stream 'truth' has steps of {steps}"
        lacking = NEEDED_FIELDS - set(truth.arrays)
        if truth.samples and lacking:
            return nothing, f"stream 'truth' has no {', '.join(sorted(lacking))}"
        with np.errstate(all="ignore"):
            books, law = recording.books, law_of(recording).scene_law
            ran = Ran(
                figures_of(setup, blocks_of(recording)), law,
                books.expected_error if books else None, late=late,
                saturation=saturation_of(recording.events),
            )  # fmt: skip
            known = predictability(setup, ran, None, why_not_again(recording))
            found = figures_as_json(ran.figures)
            return found | {
                "predictability": predictability_as_json(known),
                "verdict": verdict_sentences(verdict(ran, known=known)),
            }, ""
    except (SceneError, RecursionError) as error:
        return nothing, f"the scene inside cannot be read: {error}{recording.other_version}"
    except (ArithmeticError, ValueError) as error:
        return nothing, f"no figures follow from what was recorded: {error}"


def show(
    console: Console, recording: Recording, data: dict[str, Any], details: bool = False
) -> None:
    """Print whether a recording is complete, its figures, warnings and the next command.

    Args:
        console: Where to print.
        recording: The recording.
        data: Its summary, from `summary`.
        details: Whether to print all tables as well.
    """
    for problem in data["problems"]:
        console.print(styled(("Missing or damaged:", "red"), f" {problem}"), soft_wrap=True)
    if not data["problems"]:
        console.print(styled(("Complete: no announced message is missing.", "bold")))
    if data["unchecked_parts"]:
        console.print(f"Not checked: {without_checksum(data['unchecked_parts'])}.", soft_wrap=True)
    show_verdict(console, data)
    if data["impacts"] and data["stability"]:
        console.print(figures_table(data))
    known = data["predictability"]
    if known and known["why_not"] and len(data["impacts"]) > 1 and not details:
        console.print(f"Later impacts: digits as recorded, since {known['why_not']}.")
    show_warnings(console, data)
    if details:
        _show_details(console, data)
    show_pacing(console, data)
    console.print(
        styled(f"Scene {data['scene']}, seed {data['seed']}. Law: {law_line(law_in(data))}.")
    )
    if "residuals" in data:
        console.print(
            f"Energy residual {data['residuals']['energy']:.1e}, "
            f"momentum {data['residuals']['momentum']:.1e} (relative)."
        )
    console.print(
        styled("Recording: ", (data["file"], "bold"), ". --details prints all figures."),
        soft_wrap=True,
    )
    console.print(styled("Next: ", (f"hertzloop replay {data['file']}", "bold")), soft_wrap=True)


def _show_details(console: Console, data: dict[str, Any]) -> None:
    """Print streams, all impacts, noise figures and neglected effects."""
    title = f"{data['file']}: scene {data['scene']}, seed {data['seed']}"
    table = Table(title=title)
    for heading in ("stream", "messages", "samples", "fields"):
        table.add_column(heading, justify="left" if heading in ("stream", "fields") else "right")
    for name, stream in data["streams"].items():
        counts = (f"{stream['messages']:,}", f"{stream['samples']:,}")
        row = (*counts, ", ".join(stream["fields"]))
        table.add_row(f"/{name}", *row)
    table.add_row("/events", f"{len(data['events']):,}", "", "")
    console.print(table)
    if data["other_messages"]:
        console.print(f"Ignored: {data['other_messages']:,} messages of other topics.")
    known = data["predictability"] or {"controlled": None, "why_not": ""}
    own = known["controlled"]
    console.print(impacts_table("Impacts", data["impacts"], own, known["why_not"]))
    if data["noise"]:
        errors = [errors_of(known_in(own), 0, "noise_errors")]
        console.print(noise_table([("", data["noise"][0])], errors=errors))
    if data["demand"]:
        console.print(f"Actuator demand: {demand_words(data['demand'])}.")
    if data.get("yield"):
        console.print(f"Yield: {yield_words(data['yield'])}.")
    show_neglected(console, data["validity"])


_SPANS = {"first_impact": "first impact", "whole_run": "whole run"}


def comparison_table(found: Comparison) -> Table:
    """The figures of both runs with their units, and the change from A to B."""
    shown = Table(title="Figures of A and B, and the change from A to B")
    shown.add_column("figure")
    for heading in ("A", "B", "change"):
        shown.add_column(heading, justify="right")
    span = ""
    for row in found.rows:
        if row.span != span:
            span = row.span
            shown.add_section()
            shown.add_row(Text(_SPANS[span], style="bold"), "", "", "")
        of = SPAN_ROWS[row.figure]
        values = [_with_unit(value, of.factor, of.unit) for value in (row.a, row.b)]
        shown.add_row(of.words, *values, _change(row))
    return shown


def _with_unit(value: float, factor: float, unit: str) -> str:
    return "not defined" if value != value else f"{value * factor:.4g} {unit}".strip()


def _change(row: Difference) -> str:
    if row.b_to_a != row.b_to_a:
        return ""
    return f"{row.b_to_a:+z.2f} {row.unit}" if row.unit else f"{row.b_to_a:+z.0f}"


class PrintedComparison(Comparison):
    """A comparison that prints as its table."""

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(comparison_table(self))
        return caught.get()
