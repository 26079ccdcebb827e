"""Repair a damaged recording: copy what is readable into a new file with index and checksums."""

from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from hertzloop.common.atomic_files import whole_file
from hertzloop.recordings.reader import read_run
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.run_reader import StreamMessage
from hertzloop.recordings.writer import (
    NotRecorded,
    RecordingError,
    RecordingWriter,
    UnreadableRecording,
)


class Repaired(NamedTuple):
    """Outcome of a repair: the damaged recording, and the number of copied messages."""

    damaged: Recording
    messages: int


def repair(path: Path, whole: Path, overwrite: bool = False) -> Repaired:
    """Copy the messages of a run up to the first damage into a new file.

    The new file says that it is incomplete and why.

    Args:
        path: The damaged recording.
        whole: The new file.
        overwrite: Replace an existing file.

    Raises:
        RecordingError: there is nothing to repair, or the new file exists or is in use.
        NotWritten: the new file cannot be written.
    """
    messages: list[StreamMessage] = []
    try:
        run = read_run(path, messages.append)
    except RecordingError as error:
        raise UnreadableRecording(f"nothing to repair: {error}") from error
    if whole.exists() and whole.samefile(path):
        raise UnreadableRecording(f"{path} cannot be repaired into itself. Choose another name.")
    if not messages:
        raise UnreadableRecording(f"{path} holds no message of a run: nothing to repair")
    old = run.recording
    fault = old.result.get("fault", "")
    if old.problems and not fault:
        fault = f"repaired from {path.name}, which is cut off or damaged ({old.problems[0]})"
    with whole_file(whole) as unfinished, ExitStack() as locked:
        if unfinished != whole:
            locked.callback(RecordingWriter(whole, overwrite).finish, {})
        try:
            new = RecordingWriter(unfinished, overwrite)
            new.scene(old.scene_toml, old.metadata)
            if old.law_source:
                new.law(old.law_source)
            for stream, message in messages:
                new.write(stream, message.data, message.sequence, message.log_time)
            counts = {name: f"{c.messages} {c.samples}" for name, c in run.checker.counters.items()}
            new.finish({"complete": "no" if fault else "yes", "fault": fault, **counts})
        except NotRecorded as error:
            raise error.reason from error  # `whole_file` names the file
    return Repaired(old, len(messages))
