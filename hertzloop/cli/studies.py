"""Commands that run a study; each loads what it needs when it is called."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli.latency import latency, real, validity_map
from hertzloop.cli.options import (
    JsonOption,
    check_json,
    fail,
    make_folder,
    out,
    write_json,
)
from hertzloop.cli.recordings import FileArgument, read_or_fail


def response(
    file: FileArgument,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    json_file: JsonOption = None,
) -> None:
    """How long the answers of a paced run took, and what they had."""
    from hertzloop.analysis.recorded import pacing_of, responses_of
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.studies import law_on as picture
    from hertzloop.views.data import pacing_as_json
    from hertzloop.views.sentences import pacing_sentences

    check_json(json_file)
    recording = read_or_fail(file)
    try:
        responses, found = responses_of(recording), pacing_of(recording)
    except RecordingError as error:
        fail(str(error), 1)
    if responses is None or found is None or found.clock is None:
        fail(f"{file} has no response times; those of 'hertzloop run --pace' have", 2)
    make_folder(folder)
    try:
        picture.draw_response(folder / "response.png", responses, found)
        picture.write_table(folder / "response.csv", responses)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}", 1)
    for sentence in pacing_sentences(found):
        out.print(sentence, soft_wrap=True)
    out.print(f"written: {folder}/response.png and .csv", soft_wrap=True)
    write_json(json_file, pacing_as_json(found) or {})


def register(app: typer.Typer) -> None:
    """Add the commands."""
    chart = typer.Typer(help="Charts that measure on this machine.", no_args_is_help=True)
    chart.command("latency")(latency)
    chart.command("real")(real)
    chart.command("response")(response)
    chart.command("validity")(validity_map)
    app.add_typer(chart, name="chart")
