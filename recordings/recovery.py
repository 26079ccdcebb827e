"""Recover a damaged recording: copy what is readable into a new file with index and checksums."""

from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from hertzloop.common.atomic_files import whole_file
from hertzloop.recordings.reader import open_recording
from hertzloop.recordings.run_reader import RunReader
from hertzloop.recordings.writer import (
    NotRecorded,
    RecordingError,
    RecordingWriter,
    UnreadableRecording,
)


class Recovered(NamedTuple):
    """Outcome of a recovery.

    Attributes:
        messages: Number of copied messages.
        others: Number of messages of other topics, which were not copied.
        unchecked: Number of parts of the old file that no checksum covers.
        simulated_s: Simulated time that the new file has, s.
        missing: What is missing or damaged in the old file, in sentences.
    """

    messages: int
    others: int
    unchecked: int
    simulated_s: float
    missing: list[str]


def recover(path: Path, whole: Path, overwrite: bool = False) -> Recovered:
    """Copy every readable message of a run into a new file.

    The new file says that it is incomplete and why.

    Args:
        path: The damaged recording.
        whole: The new file.
        overwrite: Replace an existing file.

    Raises:
        RecordingError: there is nothing to recover, or the new file exists or is in use.
        NotWritten: the new file cannot be written.
    """
    try:
        old, file, run = open_recording(path)
    except RecordingError as error:
        raise UnreadableRecording(f"nothing to recover: {error}") from error
    if whole.exists() and whole.samefile(path):
        raise UnreadableRecording(f"{path} cannot be recovered into itself. Choose another name.")
    fault = old.result.get("fault", "")
    if old.problems and not fault:
        fault = f"recovered from {path.name}, which is cut off or damaged ({old.problems[0]})"
    if not run.counters:
        raise UnreadableRecording(f"{path} holds no message of a run: nothing to recover")
    copied = 0
    again = RunReader(channels=dict(run.channels))
    with whole_file(whole) as unfinished, ExitStack() as locked:
        if unfinished != whole:
            locked.callback(RecordingWriter(whole, overwrite).finish, {})
        try:
            new = RecordingWriter(unfinished, overwrite)
            new.scene(old.scene_toml, old.metadata)
            if old.law_source:
                new.law(old.law_source)
            for found in file.messages(again, file.indexed_records()):
                message = found.message
                new.write(found.stream, message.data, message.sequence, message.log_time)
                copied += 1
            counts = {name: f"{c.messages} {c.samples}" for name, c in run.counters.items()}
            new.finish({"complete": "no" if fault else "yes", "fault": fault, **counts})
        except NotRecorded as error:
            raise error.reason from error  # `whole_file` names the file
    truth = old.truth
    simulated_s = truth.samples * truth.step_ns * 1e-9
    return Recovered(copied, old.others, old.unchecked, simulated_s, list(old.problems))
