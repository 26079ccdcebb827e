"""Make a whole file of a recording that was cut off or damaged."""

from pathlib import Path
from typing import NamedTuple

from recordings.intake import Intake
from recordings.reader import Source, read
from recordings.writer import RecordingError, RecordingWriter


class Recovered(NamedTuple):
    """How many messages were copied, and how many of topics that are none of ours were not."""

    messages: int
    others: int


def recover(path: Path, whole: Path, overwrite: bool = False) -> Recovered:
    """Copy every readable message of `path` that belongs to its run into a new file, with index
    and checksums.

    The new file says that it is incomplete and why. Raises RecordingError if there is nothing to
    recover or the new file cannot be written.
    """
    try:
        old = read(path)
    except RecordingError as error:
        raise RecordingError(f"{error}: nothing to recover") from error
    if whole.exists() and whole.samefile(path):
        raise RecordingError(f"{path} cannot be recovered into itself; choose another name")
    fault = old.result.get("fault", "")
    if old.problems and not fault:
        fault = f"recovered from {path.name}, which is cut off or damaged ({old.problems[0]})"
    source = Source(path)
    seen, _ = source.look()
    if not seen.counters:
        raise RecordingError(f"{path} holds no message of a run: nothing to recover")
    writer = RecordingWriter(whole, overwrite)
    writer.scene(old.scene_toml, old.metadata)
    copied = 0
    again = Intake(channels=dict(seen.channels))
    for taken in source.messages(again, source.records()):
        message = taken.message
        writer.write(taken.stream, message.data, message.sequence, message.log_time)
        copied += 1
    writer.finish({"complete": "no" if fault else "yes", "fault": fault})
    return Recovered(copied, old.others)
