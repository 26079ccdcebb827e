"""Read a recording, whole or damaged: what is there, and in sentences what is not.

Samples are read again whenever somebody asks for them, so that a long recording needs no
more memory than what is looked at.
"""

import os
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hertzloop.bus.messages_pb2 import Books, RunEnd
from hertzloop.bus.streams import CONTROLLER, STREAMS, other_version
from hertzloop.bus.wire import DecodedBlock
from hertzloop.recordings.chunks import MAGIC, Damaged, McapRecord, Walk, intact
from hertzloop.recordings.columns import SAMPLED, Arrays, JoinedStream
from hertzloop.recordings.intake import Event, Intake, Taken, in_order
from hertzloop.recordings.writer import (
    EXPORT_LIBRARY,
    TOPICS,
    NotRecorded,
    RecordingError,
    RecordingWriter,
)
from hertzloop.whole_files import whole_file

__all__ = ["Event", "JoinedStream", "Recording", "Source", "holds_a_run", "read"]

_DAMAGES_NAMED = 5


@dataclass
class Recording:
    """What a file holds. `problems` lists gaps and damage in sentences; empty when whole.

    `others`: how many messages are of topics that are none of ours, and were passed over.
    `unchecked`: how many parts of the file no checksum covers, since another program wrote it.
    `law_ran`: name and digest of the law that the controller said it ran, empty where it did not
    say; `law_source`: text of the one that the plant announced.
    """

    path: Path
    scene_toml: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
    result: dict[str, str] = field(default_factory=dict)
    daq: JoinedStream = field(default_factory=JoinedStream)
    force: JoinedStream = field(default_factory=JoinedStream)
    truth: JoinedStream = field(default_factory=JoinedStream)
    events: list[Event] = field(default_factory=list)
    books: Books | None = None
    pacing: DecodedBlock | None = None  # a Pacing, of a paced run
    ends: dict[str, RunEnd] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    law_source: str = ""
    others: int = 0
    unchecked: int = 0

    @property
    def other_version(self) -> str:
        """By which version it was recorded and which this is, in brackets; empty for this one."""
        return other_version(self.metadata.get("versions", ""), "it was recorded by")

    @property
    def law_ran(self) -> tuple[str, str]:
        """Name and digest of the law that the controller said it ran; empty where it did not."""
        end = self.ends.get(CONTROLLER)
        return (end.set_up.law, end.set_up.law_digest) if end else ("", "")

    @property
    def daq_values(self) -> np.ndarray:
        """Acquired values in the unit of the quantity, shape (samples,)."""
        return self.daq.values_of(self.daq.arrays)


class Place(NamedTuple):
    """Where a record is, the topics of its messages, and the first number of every stream."""

    record: McapRecord
    topics: frozenset[str]
    first: dict[str, int]


class Source:
    """The file of a recording, open as long as somebody reads from it.

    Raises RecordingError, here and wherever it is read, if it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reading():
            # Without waiting for a writer, should it be a pipe.
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        status = os.fstat(self._handle)
        if not stat.S_ISREG(status.st_mode):
            kind = "Is a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise RecordingError(f"cannot read {path}: {kind}")
        self.size = status.st_size
        self._places: list[Place] = []
        self._channels: dict[int, str] = {}

    def __del__(self) -> None:
        if hasattr(self, "_handle"):
            os.close(self._handle)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            absent = isinstance(error, FileNotFoundError)
            remedy = ". Give the path of a recording." if absent else ""
            raise RecordingError(f"cannot read {self.path}: {error.strerror}{remedy}") from error

    def messages(self, intake: Intake, records: Iterable[McapRecord]) -> Iterator[Taken]:
        """All messages in `records` that belong to the run; `intake` knows then what else is
        there."""
        self._places.clear()
        with self._reading():
            for record in records:
                topics: set[str] = set()
                for taken in intake.take(record):
                    topics.add(STREAMS[taken.stream].topic)
                    yield taken
                if record.content:
                    place = Place(record._replace(content=b""), frozenset(topics), intake.first)
                    self._places.append(place)
        self._channels = intake.channels

    def walk(self) -> Walk:
        """A new walk over the file."""
        return Walk(self._handle, self.size)

    def look(self, keep: bool = False) -> tuple[Intake, Walk]:
        """Everything but the samples, or with those of the streams that are short enough to
        `keep`. The mcap library reads an intact file; past damage we walk."""
        intake, walk = Intake(keep=keep), self.walk()
        try:
            self._drain(intake, intact(walk))
            if not intake.unknown_channels and not intake.out_of_place:
                return intake, walk
        except Damaged:
            pass
        intake, walk = Intake(keep=keep), self.walk()
        self._drain(intake, walk.records())
        if intake.unknown_channels:
            # The record that names them is lost, or comes later. The summary repeats it; without
            # one, our writer's order is the best guess, and what a message is shows when it is
            # decoded.
            guessed = walk.late_channels or dict(enumerate(TOPICS, 1))
            named = intake.unknown_channels <= set(intake.channels)
            intake, walk = Intake(channels=guessed | intake.channels, keep=keep), self.walk()
            self._drain(intake, walk.records())
            intake.unnamed_channels = not named
        if intake.out_of_place:
            before = intake
            self._places = [self._places[n] for n in in_order([p.first for p in self._places])]
            intake = Intake(channels=dict(before.channels), keep=keep)
            self._drain(intake, self.records())
            intake.unnamed_channels = before.unnamed_channels
            intake.problems.append("parts of the file have changed places, or are there twice")
        return intake, walk

    def _drain(self, intake: Intake, records: Iterable[McapRecord]) -> None:
        for _ in self.messages(intake, records):
            pass

    def names_a_scene(self) -> bool:
        """Whether there is a scene, or a hello, which has one."""
        for records in (intact(self.walk()), self.walk().records()):
            intake = Intake()
            with suppress(Damaged):
                for _ in self.messages(intake, records):
                    if intake.scene_toml or intake.hello:
                        return True
                return bool(intake.scene_toml)
        return False

    def records(self) -> Iterator[McapRecord]:
        """The records once more, after `look`, in the order in which they belong."""
        walk, places = self.walk(), list(self._places)
        return (self._read(walk, place) for place in places)

    def _read(self, walk: Walk, place: Place) -> McapRecord:
        try:
            return walk.again(place.record)
        except Damaged as error:
            raise RecordingError(f"{self.path} changed while it was read ({error})") from error

    def again(self, stream: str, run_id: int) -> Iterator[Arrays]:
        """The blocks of a stream once more, after `look`."""
        topic, walk = STREAMS[stream].topic, self.walk()
        intake = Intake(channels=dict(self._channels), only=topic, run_id=run_id)
        with self._reading():
            for place in self._places:
                if topic in place.topics:
                    for taken in intake.take(self._read(walk, place)):
                        yield taken.arrays


def read(path: Path, keep: bool = False) -> Recording:
    """Read a recording as far as it is readable; with `keep`, samples of a short run stay in
    memory, for who looks at all of them.

    Raises RecordingError if there is no file, or no recording of hertzloop in it.
    """
    source = Source(path)
    if source.walk().library == EXPORT_LIBRARY:
        raise RecordingError(
            f"{path} is an export of a recording, with one message a sample. Give the recording"
        )
    intake, walk = source.look(keep)
    intake.agree()
    if not intake.scene_toml:
        if walk.read(0, 8) != MAGIC and not intake.counters:
            raise RecordingError(
                f"{path}: is not an MCAP recording of hertzloop. Its exports cannot be read back"
            )
        why = f" ({walk.damage[0]})" if walk.damage else ""
        raise RecordingError(f"{path} holds no scene{why}: not a recording of hertzloop")
    damage = [f"the file is cut off or damaged ({words})" for words in walk.damage]
    if len(damage) > _DAMAGES_NAMED:
        damage[_DAMAGES_NAMED:] = [f"... and in {len(damage) - _DAMAGES_NAMED} more places"]
    recording = Recording(
        path,
        intake.scene_toml,
        intake.metadata or {},
        intake.result or {},
        law_source=intake.law_source,
        events=intake.events,
        books=intake.books,
        pacing=intake.pacing,
        ends=intake.ends,
        others=intake.others,
        unchecked=len(walk.unchecked),
    )
    for name in SAMPLED:
        again: Callable[[], Iterator[Arrays]] = partial(source.again, name, intake.run_id)
        setattr(recording, name, intake.tracks[name].join(again))
    intake.reconcile()
    recording.problems = [*intake.problems, *damage, *_outcome(intake)]
    return recording


def _outcome(intake: Intake) -> list[str]:
    """What the recorder and the roles said of the run's end, if it was not good."""
    if intake.result is None:
        return ["the recorder did not finish the file"]
    told = [intake.result.get("fault", ""), *(end.fault for end in intake.ends.values())]
    fault = next((words for words in told if words), "")
    return [f"the run failed: {fault}"] if fault else []


def holds_a_run(path: Path) -> bool:
    """Whether a file can be read as a recording, if only its scene."""
    try:
        source = Source(path)
        return source.names_a_scene()
    except RecordingError:
        return False


class Recovered(NamedTuple):
    """How many messages were copied, how many of topics that are none of ours were not, and how
    many parts of the old file no checksum covers."""

    messages: int
    others: int
    unchecked: int


def recover(path: Path, whole: Path, overwrite: bool = False) -> Recovered:
    """Copy every readable message of `path` that belongs to its run into a new file, with index
    and checksums.

    The new file says that it is incomplete and why. Raises RecordingError if there is nothing to
    recover or the new file exists or is in use, and NotWritten.
    """
    try:
        old = read(path)
    except RecordingError as error:
        raise RecordingError(f"nothing to recover: {error}") from error
    if whole.exists() and whole.samefile(path):
        raise RecordingError(f"{path} cannot be recovered into itself. Choose another name.")
    fault = old.result.get("fault", "")
    if old.problems and not fault:
        fault = f"recovered from {path.name}, which is cut off or damaged ({old.problems[0]})"
    source = Source(path)
    seen, _ = source.look()
    if not seen.counters:
        raise RecordingError(f"{path} holds no message of a run: nothing to recover")
    copied = 0
    again = Intake(channels=dict(seen.channels))
    with whole_file(whole) as unfinished, ExitStack() as locked:
        if unfinished != whole:
            locked.callback(RecordingWriter(whole, overwrite).finish, {})
        try:
            writer = RecordingWriter(unfinished, overwrite)
            writer.scene(old.scene_toml, old.metadata)
            for taken in source.messages(again, source.records()):
                message = taken.message
                writer.write(taken.stream, message.data, message.sequence, message.log_time)
                copied += 1
            writer.finish({"complete": "no" if fault else "yes", "fault": fault})
        except NotRecorded as error:
            raise error.reason from error  # `whole_file` names the file
    return Recovered(copied, old.others, old.unchecked)
