"""The command `margin`."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.margin.jitter import at_shortest_latency
from hertzloop.studies.margin.margin import margin as analyse
from hertzloop.studies.margin.sentences import result_lines
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
    of the shortest latency.
    """
    outputs.check_json(json_file)
    if folder is not None:
        need("matplotlib")
        outputs.make_folder(folder)
    changes = list(settings or [])
    if law is not None:
        changes.insert(0, f"controller.law={law}")
    setup = prepare.scene_from(scene, changes, None)
    with progress("margin", 1) as advance:
        result = analyse(setup, lambda part: advance(0, f"margin: {part}"))
    data = result.as_data()
    for line in result_lines(result):
        out.say(line)
    outputs.write_json(json_file, data)
    if folder is None:
        return
    written = ["margin.json"]
    if result.flight.applicable:
        # Of an extra.
        from hertzloop.studies.margin.chart import draw
        from hertzloop.studies.pages import pictures

        pictures.save(draw(at_shortest_latency(setup), result), folder / "margin.png")
        LinearSystem.of(setup).save(folder / "plant.npz")
        written += ["margin.png", "plant.npz"]
    outputs.write_json(folder / "margin.json", data)
    for name in written:
        out.say(f"written: {folder / name}")
