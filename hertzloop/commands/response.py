"""The command `chart response`: how long the answers of a paced run took."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.options import JsonOption, check_json, make_folder, write_json
from hertzloop.commands.recordings import FileArgument, read_or_fail
from hertzloop.commands.terminal import fail, out


def response(
    file: FileArgument,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    json_file: JsonOption = None,
) -> None:
    """How long the answers of a paced run took, and what they had."""
    from hertzloop.analysis.recorded import pacing_of, responses_of
    from hertzloop.views.data import pacing_as_json
    from hertzloop.views.sentences import pacing_sentences
    from recordings.writer import RecordingError
    from studies import response as picture

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
        picture.draw(folder / "response.png", responses, found)
        picture.write_table(folder / "response.csv", responses)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}", 1)
    for sentence in pacing_sentences(found):
        out.print(sentence, soft_wrap=True)
    out.print(f"written: {folder}/response.png and .csv", soft_wrap=True)
    write_json(json_file, pacing_as_json(found) or {})
