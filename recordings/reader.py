"""Read a recording, complete or damaged: what it holds, and in sentences what is missing."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.records import Attachment

from hertzloop.recordings.file_format import (
    EXPORT_LIBRARY,
    FORMAT_VERSION,
    PROFILE,
    SCENE_ATTACHMENT,
    other_format,
)
from hertzloop.recordings.mcap_file import McapFile
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.run_reader import RunReader, StreamMessage
from hertzloop.recordings.writer import RecordingError, UnreadableRecording


def read(path: Path) -> Recording:
    """Read a recording up to its first damage, or as far as a run has come that records it.

    Raises:
        RecordingError: there is no file, or it is not a recording of this format.
    """
    return read_run(path).recording


def read_run(path: Path, copy: Callable[[StreamMessage], Any] = lambda found: None) -> RunReader:
    """Read a recording as `read` does; `copy` gets every message that belongs to the run."""
    file = McapFile(path)
    run = RunReader(Recording(path))
    for record in file.records():
        if file.header.library == EXPORT_LIBRARY:
            raise UnreadableRecording(
                f"{path} is an export of a recording, with one message a sample. Give the recording"
            )
        found = run.add(record)
        if found:
            copy(found)
    run.join()
    recording = run.recording
    recording.unchecked = file.unchecked
    _check_format(run, file)
    run.compare_with_hello()
    if not recording.scene_toml:
        if not file.header.library and not run.checker.counters:
            raise UnreadableRecording(
                f"{path}: is not an MCAP recording of hertzloop. Its exports cannot be read back"
            )
        why = f" ({file.damage})" if file.damage else ""
        raise UnreadableRecording(f"{path} holds no scene{why}: not a recording of hertzloop")
    run.reconcile()
    if file.damage:
        run.report(f"the file is cut off or damaged at {file.damage}; it is not read on")
    _report_outcome(run)
    return run


def holds_a_run(path: Path) -> bool:
    """Whether a file can be read as a recording, if only its scene."""
    try:
        return any(
            isinstance(record, Attachment) and record.name == SCENE_ATTACHMENT
            for record in McapFile(path).records()
        )
    except RecordingError:
        return False


def _check_format(run: RunReader, file: McapFile) -> None:
    """Raise UnreadableRecording for another format version, but not for one damaged byte."""
    metadata = run.recording.metadata
    version = other_format(metadata) if metadata else ""
    if version and file.header.profile != PROFILE:
        raise UnreadableRecording(
            f"{file.path} {version}, this hertzloop reads format version {FORMAT_VERSION}. Record "
            "the run again, or read the file with the version of hertzloop that wrote it."
        )
    if version:
        run.report(f"the file's description {version}, unlike its header")


def _report_outcome(run: RunReader) -> None:
    """Report that the run failed, or that nobody finished its file."""
    recording = run.recording
    faults = [recording.result.get("fault", ""), *(end.fault for end in recording.ends.values())]
    if not run.finished:
        run.report("the recorder did not finish the file")
    elif fault := next(filter(None, faults), ""):
        run.report(f"the run failed: {fault}")
