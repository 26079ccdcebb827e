"""The command `margin`."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import out
from hertzloop.common.optional_dependencies import need
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.margin.binding import binding_mode, mode_line
from hertzloop.studies.margin.contact import contact_margin, impact_facts
from hertzloop.studies.margin.jitter import at_shortest_latency, jitter_margin_of
from hertzloop.studies.margin.margin import margin_of
from hertzloop.studies.margin.shown import contact_lines, fact_lines, jitter_lines, margin_lines
from hertzloop.studies.margin.system import LinearSystem


def margin(
    scene: options.SceneArgument = DEFAULT,
    law: Annotated[str | None, typer.Option(help="Use this law instead of the scene's.")] = None,
    settings: options.SetOption = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out-dir",
            "-o",
            help="Folder for margin.png, margin.json, and the plant as plant.npz.",
        ),
    ] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Tell how stable a linear law's loop is in flight.

    It prints growth, latency limit, stable windows, gain margin, jitter margin, and the frequency
    and mode that limit the loop. With jitter, drop-outs or a trace of latencies these are numbers
    of the shortest latency. For a law on the contact force it prints the loop in contact, and for a
    law that is not linear when its first force acts.
    """
    outputs.check_json(json_file)
    if folder is not None:
        need("matplotlib")
        outputs.make_folder(folder)
    changes = list(settings or [])
    if law is not None:
        changes.insert(0, f"controller.law={law}")
    setup = prepare.scene_from(scene, changes, None)
    contact = facts = None
    constant = at_shortest_latency(setup)
    found = margin_of(constant)
    jitter = jitter_margin_of(setup, found)
    if not found.applicable and setup.has_law and SCHEMES[setup.scheme].has_linear_model:
        analysed = contact_margin(setup)
        if isinstance(analysed, str):
            facts = impact_facts(setup)
        else:
            contact = analysed
    data: dict[str, Any] = asdict(found) | {
        "binding_mode": None,
        "jitter": None if jitter is None else asdict(jitter),
        "contact": None if contact is None else asdict(contact),
        "impact": None if facts is None else asdict(facts),
    }
    lines = margin_lines(found) + jitter_lines(jitter)
    lines += contact_lines(contact) if contact else fact_lines(facts) if facts else []
    for line in lines:
        out.say(line)
    at_hz = found.binding_frequency_hz
    if at_hz is not None:
        mode = binding_mode(constant, at_hz)
        data["binding_mode"] = None if mode is None else asdict(mode)
        out.say(mode_line(mode, at_hz))
    outputs.write_json(json_file, data)
    if folder is None:
        return
    if not found.applicable:
        outputs.write_json(folder / "margin.json", data)
        return
    # Of an extra.
    from hertzloop.studies.margin.picture import draw
    from hertzloop.studies.pages import pictures

    pictures.save(draw(constant, found), folder / "margin.png")
    LinearSystem.of(setup).save(folder / "plant.npz")
    outputs.write_json(folder / "margin.json", data)
    for name in ("margin.png", "margin.json", "plant.npz"):
        out.say(f"written: {folder / name}")
