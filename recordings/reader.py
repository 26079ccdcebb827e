"""Read a recording, complete or damaged: what it holds, and in sentences what is missing."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from hertzloop.recordings.file_format import EXPORT_LIBRARY, FORMAT_VERSION, PROFILE, other_format
from hertzloop.recordings.joined_stream import Arrays
from hertzloop.recordings.mcap_records import MAGIC
from hertzloop.recordings.reconcile import compare_with_hello, reconcile
from hertzloop.recordings.record_scanner import RecordScanner
from hertzloop.recordings.recording import SAMPLED, Recording
from hertzloop.recordings.recording_file import RecordingFile
from hertzloop.recordings.run_reader import RunReader
from hertzloop.recordings.writer import RecordingError, UnreadableRecording

_DAMAGES_NAMED = 5


def read(path: Path, keep: bool = False) -> Recording:
    """Read a recording as far as it is readable.

    Args:
        path: The file.
        keep: Keep the samples of a short run in memory, for callers that look at all of them.

    Raises:
        RecordingError: there is no file, or it is not a recording of this format.
    """
    return open_recording(path, keep).recording


def holds_a_run(path: Path) -> bool:
    """Whether a file can be read as a recording, if only its scene."""
    try:
        return RecordingFile(path).names_a_scene()
    except RecordingError:
        return False


class OpenRecording(NamedTuple):
    """A recording, with its open file and everything that was read of the run."""

    recording: Recording
    file: RecordingFile
    run: RunReader


def open_recording(path: Path, keep: bool = False) -> OpenRecording:
    """Read a recording as `read` does, and keep its file open."""
    file = RecordingFile(path)
    if file.scanner().header.library == EXPORT_LIBRARY:
        raise UnreadableRecording(
            f"{path} is an export of a recording, with one message a sample. Give the recording"
        )
    run, scanner = file.scan(keep)
    _check_format(path, run, scanner)
    compare_with_hello(run)
    if not run.scene_toml:
        raise _not_a_recording(path, run, scanner)
    recording = Recording(
        path,
        run.scene_toml,
        run.metadata or {},
        run.result or {},
        events=run.events,
        balance=run.balance,
        pacing=run.pacing,
        ends=run.ends,
        law_source=run.law_source,
        others=run.others,
        unchecked=len(scanner.unchecked),
    )
    for name in SAMPLED:  # each is an attribute of a Recording
        read_blocks: Callable[[], Iterator[Arrays]] = partial(file.blocks, name, run.run_id)
        setattr(recording, name, run.assemblers[name].join(read_blocks))
    reconcile(run)
    recording.problems = [*run.problems, *_damage(scanner), *_outcome(run)]
    return OpenRecording(recording, file, run)


def _check_format(path: Path, run: RunReader, scanner: RecordScanner) -> None:
    """Raise UnreadableRecording for another format version, but not for one damaged byte."""
    version = "" if run.metadata is None else other_format(run.metadata)
    if version and scanner.header.profile != PROFILE:
        raise UnreadableRecording(
            f"{path} {version}, this hertzloop reads format version {FORMAT_VERSION}. Record the "
            "run again, or read the file with the version of hertzloop that wrote it."
        )
    if version:
        run.report(f"the file's description {version}, unlike its header")


def _not_a_recording(path: Path, run: RunReader, scanner: RecordScanner) -> UnreadableRecording:
    if scanner.read(0, len(MAGIC)) != MAGIC and not run.counters:
        return UnreadableRecording(
            f"{path}: is not an MCAP recording of hertzloop. Its exports cannot be read back"
        )
    why = f" ({scanner.damage[0]})" if scanner.damage else ""
    return UnreadableRecording(f"{path} holds no scene{why}: not a recording of hertzloop")


def _damage(scanner: RecordScanner) -> list[str]:
    found = [f"the file is cut off or damaged ({words})" for words in scanner.damage]
    if len(found) > _DAMAGES_NAMED:
        found[_DAMAGES_NAMED:] = [f"... and in {len(found) - _DAMAGES_NAMED} more places"]
    return found


def _outcome(run: RunReader) -> list[str]:
    """Return a sentence if the run failed, or nobody finished its file."""
    if run.result is None:
        return ["the recorder did not finish the file"]
    faults = [run.result.get("fault", ""), *(end.fault for end in run.ends.values())]
    return [f"the run failed: {fault}" for fault in faults if fault][:1]
