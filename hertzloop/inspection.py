"""What a recording holds: for `hertzloop inspect`."""

from typing import Any

from rich.console import Console
from rich.table import Table

from hertzloop import figures, report
from hertzloop.scene import SceneError, parse
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
        "seed": int(recording.metadata.get("seed", 0)),
        "steps": int(recording.metadata.get("steps", 0)),
        "streams": streams,
        "events": [
            {"time_s": e.time_ns * 1e-9, "name": e.name, "message": e.message}
            for e in recording.events
        ],
        "scene_toml": recording.scene_toml,
    }
    if recording.books is not None:
        data["residuals"] = {
            "momentum": recording.books.momentum_residual,
            "energy": recording.books.energy_residual,
        }
    try:
        scene = parse(recording.scene_toml)
        data |= figures.figures_of(scene, figures.rows_of(recording))
    except SceneError as error:
        data["problems"] = [*recording.problems, f"the scene inside cannot be read: {error}"]
        data |= {"impacts": [], "noise": []}
    return data


def show(console: Console, recording: Recording, data: dict[str, Any]) -> None:
    """Print a summary."""
    table = Table(title=f"{data['file']}: scene {data['scene']}, seed {data['seed']}")
    for heading in ("stream", "messages", "samples", "fields"):
        table.add_column(heading, justify="left" if heading in ("stream", "fields") else "right")
    for name, stream in data["streams"].items():
        row = (f"{stream['messages']:,}", f"{stream['samples']:,}", ", ".join(stream["fields"]))
        table.add_row(f"/{name}", *row)
    table.add_row("/events", f"{len(data['events']):,}", "", "")
    console.print(table)
    console.print(report.impacts_table("Impacts", data["impacts"]))
    if data["noise"]:
        console.print(report.noise_table([("", data["noise"][0])]))
    if "residuals" in data:
        console.print(
            f"Residuals: energy {data['residuals']['energy']:.1e}, "
            f"momentum {data['residuals']['momentum']:.1e} (relative)"
        )
    for problem in data["problems"]:
        console.print(f"[red]missing or damaged:[/red] {problem}", soft_wrap=True)
    if not data["problems"]:
        console.print("Complete: every announced message is here.")
