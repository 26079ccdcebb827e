"""Read a recording, whole or cut off: streams joined over their blocks."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader

from bus import streams as bus_streams
from bus import wire
from bus.messages_pb2 import Books, RunEnd
from bus.wire import MessageError, array_fields
from recordings.writer import RESULT_METADATA, RUN_METADATA, SCENE_ATTACHMENT, RecordingError

_TOPICS = {s.topic: s for s in bus_streams.STREAMS.values() if s.topic not in ("/events", "/end")}


@dataclass(frozen=True)
class Event:
    """A foxglove.Log: simulated time in ns, publisher ("plant", "controller"), level, text."""

    time_ns: int
    name: str
    level: int
    message: str


@dataclass
class Stream:
    """One stream joined over its blocks: arrays by field name, all of one length.

    `first_step`, `step_ns` and `every_steps` give the time of each sample.
    """

    messages: int = 0
    first_step: int = 0
    step_ns: int = 0
    every_steps: int = 1
    scale: float = 1.0
    offset: float = 0.0
    arrays: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return max((len(a) for a in self.arrays.values()), default=0)

    @property
    def time_ns(self) -> np.ndarray:
        """Simulated time of every sample, shape (samples,), ns."""
        steps = self.first_step + self.every_steps * np.arange(self.samples, dtype=np.int64)
        return steps * self.step_ns


@dataclass
class Recording:
    """What a file holds. `problems` lists gaps and damage in sentences; empty when whole."""

    path: Path
    scene_toml: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
    result: dict[str, str] = field(default_factory=dict)
    daq: Stream = field(default_factory=Stream)
    force: Stream = field(default_factory=Stream)
    truth: Stream = field(default_factory=Stream)
    events: list[Event] = field(default_factory=list)
    books: Books | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    @property
    def daq_values(self) -> np.ndarray:
        """Acquired values in the unit of the quantity, shape (samples,)."""
        codes = self.daq.arrays.get("code")
        if codes is not None and len(codes):
            return np.asarray(self.daq.offset + self.daq.scale * codes)
        return self.daq.arrays.get("value", np.empty(0))


class _Joiner:
    """Collects the blocks of one stream and notes what does not join."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.stream = Stream()
        self.saturated: list[bytes] = []
        self.parts: dict[str, list[np.ndarray]] = {
            field_name: [] for field_name in array_fields(bus_streams.STREAMS[name].message)
        }
        self.next_step = 0

    def add(self, header: Any, arrays: dict[str, np.ndarray], problems: list[str]) -> None:
        stream = self.stream
        if stream.messages == 0:
            stream.step_ns = header.step_ns
            stream.every_steps = getattr(header, "every_steps", 1)
            stream.scale = getattr(header, "scale", 1.0)
            stream.offset = getattr(header, "offset", 0.0)
        if header.sequence != stream.messages or header.first_step != self.next_step:
            problems.append(
                f"stream '{self.name}': sequence {header.sequence} at step {header.first_step} "
                f"follows where sequence {stream.messages} at step {self.next_step} was expected"
            )
        stream.messages += 1
        count = max((len(a) for a in arrays.values()), default=0)
        self.next_step = header.first_step + count * stream.every_steps
        for name, values in arrays.items():
            self.parts[name].append(values)
        self.saturated.append(getattr(header, "saturated", b""))

    def join(self) -> Stream:
        arrays = {n: np.concatenate(p) for n, p in self.parts.items() if sum(map(len, p))}
        if any(self.saturated):
            arrays["saturated"] = np.frombuffer(b"".join(self.saturated), np.uint8)
        self.stream.arrays = arrays
        return self.stream


class Damage(Exception):
    """Where a file stops being readable."""


def records(path: Path) -> Iterator[McapRecord]:
    """All records of a file in order, checksums verified.

    Raises Damage at the first one that is cut off or damaged, RecordingError if the file
    cannot be opened.
    """
    try:
        with path.open("rb") as file:
            # No record is larger than its file: a damaged length must not claim the memory.
            size = path.stat().st_size
            reader = StreamReader(file, validate_crcs=True, record_size_limit=size)
            yield from reader.records
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except Exception as error:  # whatever MCAP and zstd make of bytes that mean nothing
        raise Damage(str(error) or type(error).__name__) from error


def read(path: Path) -> Recording:
    """Read a recording as far as it is readable.

    Raises RecordingError if there is no file, or no recording of hertzloop in it.
    """
    recording = Recording(path)
    joiners = {name: _Joiner(name) for name in ("daq", "force", "truth")}
    channels: dict[int, str] = {}
    finished = False
    try:
        for record in records(path):
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            elif isinstance(record, Attachment) and record.name == SCENE_ATTACHMENT:
                recording.scene_toml = record.data.decode()
            elif isinstance(record, Metadata):
                finished |= record.name == RESULT_METADATA
                _take_metadata(recording, record)
            elif isinstance(record, Message):
                _take_message(recording, joiners, channels.get(record.channel_id, ""), record)
    except (Damage, MessageError, ValueError) as error:
        if not recording.scene_toml and not channels:
            raise RecordingError(f"{path} is not a recording of hertzloop: {error}") from error
        recording.problems.append(f"the file is cut off or damaged ({error})")
    if not recording.scene_toml:
        raise RecordingError(f"{path} holds no scene: not a recording of hertzloop")
    recording.daq, recording.force, recording.truth = (
        joiners[name].join() for name in ("daq", "force", "truth")
    )
    _check_ends(recording, finished)
    return recording


def _take_metadata(recording: Recording, record: Metadata) -> None:
    if record.name == RUN_METADATA:
        recording.metadata = dict(record.metadata)
    elif record.name == RESULT_METADATA:
        recording.result = dict(record.metadata)


def _take_message(
    recording: Recording, joiners: dict[str, _Joiner], topic: str, record: Message
) -> None:
    if topic == "/events":
        log = wire.decode(bus_streams.Log, record.data).header
        recording.events.append(Event(record.log_time, log.name, log.level, log.message))
    elif topic == "/end":
        end = wire.decode(RunEnd, record.data).header
        recording.ends[end.role] = end
    elif topic in _TOPICS:
        stream = _TOPICS[topic].name
        block = bus_streams.decode(bus_streams.Envelope(stream, record.data))
        if stream == "books":
            recording.books = block.header
        elif stream in joiners:
            joiners[stream].add(block.header, block.arrays, recording.problems)


def _check_ends(recording: Recording, finished: bool) -> None:
    """Compare what is there with what the roles announced."""
    try:
        steps = int(recording.metadata.get("steps", 0))
    except ValueError:
        recording.problems.append("the length of the run cannot be read")
        steps = 0
    for role in (bus_streams.PLANT, bus_streams.CONTROLLER):
        if role not in recording.ends:
            recording.problems.append(f"the {role} announced no end: counts cannot be reconciled")
            continue
        for count in recording.ends[role].count:
            stream = {"daq": recording.daq, "force": recording.force, "truth": recording.truth}.get(
                count.stream
            )
            if stream and (stream.messages, stream.samples) != (count.messages, count.samples):
                recording.problems.append(
                    f"stream '{count.stream}': {stream.messages} messages with {stream.samples} "
                    f"samples are here, {count.messages} with {count.samples} were announced"
                )
    if recording.truth.samples < steps:
        recording.problems.append(
            f"stream 'truth' ends at step {recording.truth.samples} of {steps}"
        )
    if not finished:
        recording.problems.append("the recorder did not finish the file")
    elif recording.result.get("fault"):
        recording.problems.append(f"the run failed: {recording.result['fault']}")
