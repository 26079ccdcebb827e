"""File of a recording: one pass over its records, and an index to read its samples again."""

import os
import stat
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from hertzloop.bus import streams
from hertzloop.common.missing_files import why_unreadable
from hertzloop.recordings.file_format import TOPICS
from hertzloop.recordings.joined_stream import Arrays
from hertzloop.recordings.mcap_records import CorruptRecord, McapRecord
from hertzloop.recordings.record_scanner import RecordScanner
from hertzloop.recordings.run_reader import RunReader, StreamMessage
from hertzloop.recordings.writer import RecordingError, UnreadableRecording


class IndexEntry(NamedTuple):
    """A record, without its content; the topics of its messages; and the number of its first
    message of each stream."""

    record: McapRecord
    topics: frozenset[str]
    first: dict[str, int]


class RecordingFile:
    """The file of a recording, open as long as somebody reads from it.

    The constructor and all methods raise RecordingError if the file cannot be read, or is no longer
    what it was.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reading():
            # Without waiting for a writer, should it be a pipe.
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        status = os.fstat(self._handle)
        if not stat.S_ISREG(status.st_mode):
            kind = "Is a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise UnreadableRecording(f"cannot read {path}: {kind}")
        self.size = status.st_size
        self._index: list[IndexEntry] = []
        self._channels: dict[int, str] = {}

    def __del__(self) -> None:
        if hasattr(self, "_handle"):
            os.close(self._handle)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            why = why_unreadable(self.path, error, "Give the path of a recording.")
            raise UnreadableRecording(f"cannot read {self.path}: {why}") from error

    def scanner(self) -> RecordScanner:
        """Return a new scanner over the file."""
        return RecordScanner(self._handle, self.size)

    def messages(self, run: RunReader, records: Iterable[McapRecord]) -> Iterator[StreamMessage]:
        """Yield all messages in `records` that belong to the run, and index the records.

        `run` keeps what else the records hold.
        """
        self._index.clear()
        with self._reading():
            for record in records:
                topics: set[str] = set()
                for found in run.messages_in(record):
                    topics.add(streams.STREAMS[found.stream].topic)
                    yield found
                if record.content:
                    without_content = record._replace(content=b"")
                    self._index.append(IndexEntry(without_content, frozenset(topics), run.first))
        self._channels = run.channels

    def scan(self, keep: bool = False) -> tuple[RunReader, RecordScanner]:
        """Read the whole file: once, unless its parts are not where they belong.

        Args:
            keep: Keep the samples of streams that are short enough in memory.

        Returns:
            The run, and the scanner that knows the damage.
        """
        scanner = self.scanner()
        run = self._read_all(RunReader(keep=keep), scanner.records())
        if run.unknown_channels:
            # The record that names them is lost, or comes later. The summary repeats it. Without a
            # summary, the order in which the writer names them is the best guess: a message of
            # another topic cannot be decoded.
            guessed = scanner.late_channels or dict(enumerate(TOPICS, 1))
            named = run.unknown_channels <= set(run.channels)
            again = RunReader(guessed | run.channels, unnamed_channels=not named, keep=keep)
            run = self._read_all(again, self.indexed_records())
        if run.out_of_place:
            self._index = [self._index[n] for n in in_order([e.first for e in self._index])]
            again = RunReader(run.channels, unnamed_channels=run.unnamed_channels, keep=keep)
            run = self._read_all(again, self.indexed_records())
            run.problems.append("parts of the file have changed places, or are there twice")
        return run, scanner

    def _read_all(self, run: RunReader, records: Iterable[McapRecord]) -> RunReader:
        for _ in self.messages(run, records):
            pass
        return run

    def names_a_scene(self) -> bool:
        """Whether the file holds a scene, or a hello, which has one."""
        run = RunReader()
        for _ in self.messages(run, self.scanner().records()):
            if run.scene_toml or run.hello:
                return True
        return bool(run.scene_toml)

    def indexed_records(self) -> Iterator[McapRecord]:
        """Return the records once more, after `scan`, in the order in which they belong."""
        scanner, index = self.scanner(), list(self._index)
        return (self._reread(scanner, entry) for entry in index)

    def _reread(self, scanner: RecordScanner, entry: IndexEntry) -> McapRecord:
        try:
            return scanner.reread(entry.record)
        except CorruptRecord as error:
            raise RecordingError(f"{self.path} changed while it was read ({error})") from error

    def blocks(self, stream: str, run_id: int) -> Iterator[Arrays]:
        """Yield the blocks of a stream of a run once more, after `scan`."""
        topic, scanner = streams.STREAMS[stream].topic, self.scanner()
        run = RunReader(channels=dict(self._channels), only=topic, run_id=run_id)
        with self._reading():
            for entry in self._index:
                if topic in entry.topics:
                    for found in run.messages_in(self._reread(scanner, entry)):
                        yield found.arrays


def in_order(numbers: Sequence[Mapping[str, int]]) -> list[int]:
    """Return the order of the parts of a file in which the messages of each stream ascend.

    Args:
        numbers: For each part, the number of its first message of each stream.

    Returns:
        Positions of the parts. The present order if no order suits all streams: the file is forged.
    """
    by_stream: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for position, first in enumerate(numbers):
        for stream, number in first.items():
            by_stream[stream].append((number, position))
    graph = TopologicalSorter[int]({position: () for position in range(len(numbers))})
    for of_stream in by_stream.values():
        for (_, position), (_, follows) in pairwise(sorted(of_stream)):
            graph.add(follows, position)
    try:
        return list(graph.static_order())
    except CycleError:
        return list(range(len(numbers)))
