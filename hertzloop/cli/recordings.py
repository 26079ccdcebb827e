"""Commands on recordings: inspect, compare, replay, repair, report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hertzloop.cli import options, outputs
from hertzloop.cli.terminal import err, fail, out, say_problems
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.optional_dependencies import need
from hertzloop.common.readable import quantity
from hertzloop.loop.repeated_run import RepeatedRun, repeated_run
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.repair import repair as repair_file
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.recorded import setup_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.toml import to_toml

if TYPE_CHECKING:
    from hertzloop.scene.setup import Setup


# Commands import what they alone need: views take 0.06 s, Rerun 0.5 s, and drawing is in an extra.


def scene_to_run(recording: Recording) -> "Setup":
    """Return the scene of a recording; end the command if it cannot be simulated here."""
    try:
        return setup_of(recording, to_run=True)
    except RecordingError as error:
        fail(str(error))


def repeat_or_fail(recording: Recording, setup: "Setup") -> RepeatedRun:
    """Return the forces and delays to repeat; end the command for a recording of another scene."""
    if to_toml(setup.scene) != recording.scene_toml:
        fail(f"{recording.path}: recorded with a different scene{recording.other_version}")
    return repeated_run(recording)


def inspect(
    file: options.FileArgument,
    json_file: options.JsonOption = None,
    law_file: Annotated[
        Path | None,
        typer.Option(
            "--law", metavar="OUT.py", help="Write the text of the law that ran to this file."
        ),
    ] = None,
    overwrite: options.OverwriteOption = False,
    details: options.DetailsOption = False,
) -> None:
    """Check a recording and print its metrics.

    The exit code is 1 if a message is missing or damaged.
    """
    from hertzloop.results.inspection import inspected
    from hertzloop.views.report import print_inspection
    from hertzloop.views.run_json import inspection_as_json

    outputs.check_json(json_file, law_file)
    recording = read(file)
    if law_file is not None:
        _write_law(recording, law_file, overwrite)
    found = inspected(recording)
    print_inspection(out, found, details)
    outputs.write_json(json_file, inspection_as_json(found))
    if found.problems:
        raise typer.Exit(1)


def _write_law(recording: Recording, file: Path, overwrite: bool) -> None:
    """Write the text of the law that ran; ends the command if there is none."""
    from hertzloop.views.provenance import text_of_law

    outputs.check_output(file, overwrite, "--law", [recording.path])
    try:
        atomic_write(file, text_of_law(recording))
    except RecordingError as error:
        fail(f"--law {file}: {error}")
    err.say(f"written: {file}")


def compare(
    a: Annotated[Path, typer.Argument(metavar="A.mcap")],
    b: Annotated[Path, typer.Argument(metavar="B.mcap")],
    tolerance: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Allow this difference relative to the largest value of a field; for "
            "different processors, for example 1e-9.",
        ),
    ] = 0.0,
    metrics: Annotated[
        bool,
        typer.Option(
            "--metrics",
            help="Print the metrics of both runs and their change instead of comparing bytes.",
        ),
    ] = False,
    json_file: options.JsonOption = None,
    details: options.DetailsOption = False,
) -> None:
    """Compare the bytes or the metrics of two recordings.

    The exit code is 0 if every compared stream has the same bytes, else 1.
    """
    if json_file and not metrics:
        fail(f"--json = {json_file}: there are no metrics to write. Add --metrics.")
    if details and not metrics:
        fail("--details: there are no metrics to print. Add --metrics.")
    if tolerance and metrics:
        fail("--tolerance: cannot be combined with --metrics. Remove one of the two.")
    outputs.check_json(json_file, a, b)
    left, right = read(a), read(b)
    say_problems(left)
    say_problems(right)
    if metrics:
        _compare_metrics(left, right, json_file, details)
        return
    until = _horizon(left, tolerance) if tolerance else None
    difference = first_difference(left, right, tolerance, until)
    if difference:
        out.say(difference)
        raise typer.Exit(1)
    within = f" within {tolerance:g} of the largest" if tolerance else ""
    if until is not None:
        out.say(
            f"Compared up to {until * left.truth.step_ns * 1e-6:.6g} ms: from there on the run "
            f"depends on rounding by more than {tolerance:g}, so that processors may differ."
        )
    out.print(
        f"the same{within}: {left.truth.samples:,} steps of truth, {left.daq.samples:,} samples, "
        f"{left.force.samples:,} forces, {len(left.events)} events"
    )


def _compare_metrics(
    left: Recording, right: Recording, json_file: Path | None, details: bool
) -> None:
    """Print the metrics of both runs, and their change."""
    from hertzloop.results.inspection import inspected
    from hertzloop.results.metric_rows import comparison, values_in
    from hertzloop.views.metrics_table import Comparison
    from hertzloop.views.run_json import rows_as_json

    found = []
    for recording in (left, right):
        one = inspected(recording)
        if one.assessment is None or one.assessment.result.metrics.first_impact is None:
            why = [*one.problems, "there is no contact in it"][0]
            fail(f"{recording.path} has no metrics: {why}", 1)
        found.append(values_in(one.assessment.rows))
        out.say(
            f"{'AB'[len(found) - 1]}: {recording.path}, scene "
            f"{recording.metadata.get('scene', '')}, law {one.law.scene_law}"
        )
    both = Comparison(comparison(*found))
    out.print(both.table(details))
    named = {"a": str(left.path), "b": str(right.path)}
    outputs.write_json(json_file, {**named, "metrics": rows_as_json(both.rows)})


def _horizon(recording: Recording, tolerance: float) -> int | None:
    """Return the step up to which another processor gives the same run.

    None: the whole run, or unknown, since its scene cannot be simulated here.
    """
    from hertzloop.results.predictability import horizon_step

    try:
        return horizon_step(setup_of(recording, to_run=True), tolerance)
    except (RecordingError, SceneError) as error:
        err.say(f"compared to the end: {error}")
        return None


def replay(
    file: options.FileArgument,
    other: Annotated[
        Path | None,
        typer.Argument(
            metavar="[B.mcap]",
            show_default=False,
            help="Compare with this recording; default: the run without control.",
        ),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="F.rrd", help="Write an .rrd file for the Rerun viewer.")
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png", help="Write a picture of the first contact; needs no screen."
        ),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--alone", help="Show the recording without a comparison.")
    ] = False,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Watch a recording in slow motion beside the run without control.

    The replay shows plate, forces, energies and events. It opens a window unless --save or
    --screenshot is given. A second recording replaces the run without control.
    """
    for option, output, ending in (("--save", save, ".rrd"), ("--screenshot", screenshot, ".png")):
        if output is not None:
            if output.suffix != ending:
                fail(f"{option} = {output}: must end in {ending}. Change the name.")
            outputs.check_output(output, overwrite, option, [file])
    if alone and other is not None:
        fail(f"--alone: cannot be combined with the recording {other}. Remove one of the two.")
    recording = read(file)
    compared = read(other) if other else None

    # Here and not above: Rerun takes a second to load, and only a replay needs it.
    from hertzloop.views import replaying

    if save is None and screenshot is None and not replaying.has_display():
        fail(
            "no screen is available. Write a picture with --screenshot F.png, or a file for the "
            "Rerun viewer with --save F.rrd."
        )
    say_problems(recording)
    if compared:
        say_problems(compared)
    replaying.replay(recording, save, screenshot, compared, alone)
    for output in (save, screenshot):
        if output is not None:
            out.say(f"written: {output}")


def repair(
    file: options.FileArgument,
    out_file: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the repaired file here; default: F-repaired.mcap."),
    ] = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Copy what is readable of a damaged recording into a complete file.

    A recording is readable up to its first damage. Every MCAP tool opens the new file.
    """
    from hertzloop.views.report import without_checksum

    repaired = out_file or file.with_name(f"{file.stem}-repaired.mcap")
    outputs.check_recording(repaired, overwrite, read=[file])
    damaged, messages = repair_file(file, repaired, overwrite)
    simulated_s = damaged.truth.end_step * damaged.truth.step_ns * 1e-9
    there = f"{quantity(simulated_s, 's')}{_of_announced(repaired)} of simulated time"
    ignored = f"; ignored: {damaged.others:,} of other topics" if damaged.others else ""
    out.say(f"repaired: {repaired} has {there}, {messages:,} messages{ignored}")
    for problem in damaged.problems:
        err.say(f"missing or damaged in {file}: {problem}")
    if damaged.unchecked:
        err.say(f"{file}: {without_checksum(damaged.unchecked)}.")


def _of_announced(repaired: Path) -> str:
    """Return how long the run of a recovered recording was to be; "" if its scene is unknown."""
    try:
        return f" of {quantity(setup_of(read(repaired)).run.duration_s, 's')}"
    except RecordingError:
        return ""


def report(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="F.mcap",
            help="Recording.",
        ),
    ],
    folder: Annotated[
        Path,
        typer.Option(
            "--out-dir",
            "-o",
            metavar="DIR",
            help="Write the page into this folder; default: the working folder.",
        ),
    ] = Path(),
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write an HTML report on a recording.

    The page needs no other file. It has the verdict, tables, charts, the scene, and how to run it
    again.
    """
    need("matplotlib", "jinja2")
    from hertzloop.studies.report.page import page_of

    recording = read(source)
    outputs.make_folder(folder)
    page = folder / f"{source.stem}.html"
    outputs.check_output(page, overwrite, "--out-dir", [source])
    say_problems(recording)
    try:
        text = page_of(recording)
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)
    atomic_write(page, text)
    out.say(f"written: {page} ({len(text.encode()) / 1e6:z.1f} MB)")
