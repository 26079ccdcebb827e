"""What a recording holds: for `hertzloop inspect`."""

from typing import Any

import numpy as np
from rich.console import Console

from hertzloop.commands.terminal import Table, styled
from hertzloop.results import figures, pacing, report
from hertzloop.results.conclusions import predictability, why_not_again
from hertzloop.results.impacts_table import impacts_table
from hertzloop.results.law import law_line, law_of
from hertzloop.results.left_out import show_left_out
from hertzloop.results.predictability import errors_of
from hertzloop.results.verdict import saturation_of, verdict
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import parse
from recordings.reader import Recording


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
        "events": [
            {"time_s": e.time_ns * 1e-9, "name": e.name, "message": e.message}
            for e in recording.events
        ],
        "scene_toml": recording.scene_toml,
        **law_of(recording),
    }
    if recording.books is not None:
        data["residuals"] = {
            "momentum": recording.books.momentum_residual,
            "energy": recording.books.energy_residual,
        }
        data["yield"] = figures.yield_of(recording.books)
    data["pacing"] = pacing.of(recording)
    found, problem = _figures(recording, data)
    data |= found
    data["verdict"] = verdict(data, saturation_of(recording.events)) if not problem else []
    if problem:
        data["problems"] = [*recording.problems, problem]
        data["complete"] = False
    return data


def _number(recording: Recording, key: str) -> int:
    """A number of the run's description, 0 where there is none."""
    try:
        return int(recording.metadata.get(key, "0"))
    except ValueError:
        return 0


def _figures(recording: Recording, data: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """Impacts, noise, stability and demand, and why there are none. What a file says of itself may
    be anything: numbers that no figures follow from are one more thing wrong with it, not with us.
    """
    nothing: dict[str, Any] = {"impacts": [], "noise": [], "first_impact": None,
                               "whole_run": None, "stability": None, "demand": None,
                               "validity": [], "warnings": [], "push": None,
                               "last_contact_ended": True, "predictability": None}  # fmt: skip
    truth = recording.truth
    try:
        setup = parse(recording.scene_toml, recorded=True)
        if truth.samples and setup.step_ns != truth.step_ns:
            steps = f"{truth.step_ns} ns, those of its scene {setup.step_ns} ns"
            return nothing, f"stream 'truth' has steps of {steps}"
        lacking = figures.NEEDED_FIELDS - set(truth.arrays)
        if truth.samples and lacking:
            return nothing, f"stream 'truth' has no {', '.join(sorted(lacking))}"
        with np.errstate(all="ignore"):
            found = figures.figures_of(setup, figures.blocks_of(recording))
            books, late = recording.books, data["pacing"] is not None
            error = {"expected_error": books.expected_error if books else None}
            known = predictability(setup, found | error, late, why_not_again(recording))
            return found | {"predictability": known}, ""
    except (SceneError, RecursionError) as error:
        return nothing, f"the scene inside cannot be read: {error}{recording.other_version}"
    except (ArithmeticError, ValueError) as error:
        return nothing, f"no figures follow from what was recorded: {error}"


def show(console: Console, recording: Recording, data: dict[str, Any]) -> None:
    """Print a summary."""
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
        console.print(f"Passed over: {data['other_messages']:,} messages of other topics.")
    console.print(styled("Law really run: ", law_line(data)), soft_wrap=True)
    known = data["predictability"] or {"controlled": None, "why_not": ""}
    own = known["controlled"]
    console.print(impacts_table("Impacts", data["impacts"], own, known["why_not"]))
    if data["noise"]:
        errors = [errors_of(own, 0, "noise_errors")]
        console.print(report.noise_table([("", data["noise"][0])], errors=errors))
    if data["demand"]:
        console.print(f"Demand on the actuator: {report.demand_words(data['demand'])}.")
    if data.get("yield"):
        console.print(f"Yield: {report.yield_words(data['yield'])}.")
    show_left_out(console, data["validity"])
    report.show_verdict(console, data["verdict"])
    pacing.show(console, data)
    if "residuals" in data:
        console.print(
            f"Residuals: energy {data['residuals']['energy']:.1e}, "
            f"momentum {data['residuals']['momentum']:.1e} (relative)"
        )
    for problem in data["problems"]:
        console.print(styled(("missing or damaged:", "red"), f" {problem}"), soft_wrap=True)
    if not data["problems"]:
        console.print("Complete: every announced message is here.")
