"""What a recording says of its run, from the records of its file one after the other.

Every message passes the checks that the recorder made when it came over the bus.
"""

import sys
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata

from hertzloop.bus import codec, streams
from hertzloop.bus.codec import DecodedBlock, MessageError
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import CONTROLLER, PLANT, Envelope, StreamFault
from hertzloop.recordings.file_format import (
    LAW_ATTACHMENT,
    RESULT_METADATA,
    RUN_METADATA,
    SCENE_ATTACHMENT,
    TOPICS,
    run_metadata,
)
from hertzloop.recordings.recording import SAMPLED, Event, Recording, SampledStream, event_data

MOST_EVENTS = 1_000_000  # a sphere at rest: 130 000 in 20 million steps
_MOST_PROBLEMS = 40
_DIGITS = 20  # more than the number of steps of any run has
_SHARED = "/events", "/end"  # topics of two streams each


class StreamMessage(NamedTuple):
    """A message that belongs to the run: its stream, and the message as recorded."""

    stream: str
    message: Message


@dataclass
class RunReader:
    """Reads records one by one, and fills in the recording with what belongs to the run.

    Attributes:
        recording: The recording so far; `join` completes its streams.
        checker: Checks every message; knows the hello and the counts.
        finished: Whether the file has a result of the run.
    """

    recording: Recording
    checker: SequenceChecker = field(default_factory=SequenceChecker)
    finished: bool = False
    _announced_toml: str = ""  # the whole scene, if the hello leaves out some of it
    _channels: dict[int, str] = field(default_factory=dict)
    _ended: set[str] = field(default_factory=set)  # streams with a fault: they are not read on
    _columns: dict[str, dict[str, tuple[np.dtype, bytearray]]] = field(
        default_factory=lambda: {name: {} for name in SAMPLED}
    )

    def report(self, sentence: str) -> None:
        """Add to the problems of the recording, unless there are too many."""
        problems = self.recording.problems
        if len(problems) < _MOST_PROBLEMS:
            problems.append(sentence)
        elif len(problems) == _MOST_PROBLEMS:
            problems.append("and more problems of this kind")

    def add(self, record: McapRecord) -> StreamMessage | None:
        """Take a record; return its message if it is one of the run."""
        if isinstance(record, Channel):
            self._channels[record.id] = record.topic
        elif isinstance(record, Attachment):
            self._attachment(record)
        elif isinstance(record, Metadata):
            self._metadata(record)
        elif isinstance(record, Message):
            topic = self._channels.get(record.channel_id)
            if topic is None:
                self.report("the file does not say what some messages are")
            elif topic not in TOPICS:
                self.recording.others += 1
            else:
                return self._message(topic, record)
        return None

    def _attachment(self, attachment: Attachment) -> None:
        text = attachment.data.decode(errors="replace")
        found = self.recording
        if attachment.name == LAW_ATTACHMENT:
            found.law_source = found.law_source or text
        elif attachment.name == SCENE_ATTACHMENT:
            if found.scene_toml:
                self.report("there is a second scene; the first is used")
            found.scene_toml = found.scene_toml or text

    def _metadata(self, metadata: Metadata) -> None:
        found = self.recording
        if metadata.name == RUN_METADATA:
            if found.metadata:
                self.report("there is a second description of the run; the first is used")
            found.metadata = found.metadata or dict(metadata.metadata)
        elif metadata.name == RESULT_METADATA:
            if self.finished:
                self.report("there is a second result of the run; the first is used")
            found.result, self.finished = found.result or dict(metadata.metadata), True

    def _message(self, topic: str, message: Message) -> StreamMessage | None:
        name = topic[1:]
        try:
            if topic in _SHARED:
                name = _stream_of(topic, message.data)
            if name in self._ended:
                return None
            block = self.checker.accept(Envelope(name, message.data, message.sequence))
            self._keep(name, block)
        except (MessageError, StreamFault) as error:
            self.report(f"{error}; the stream is not read on")
            self._ended.add(name)
            return None
        return StreamMessage(name, message)

    def _keep(self, name: str, block: DecodedBlock) -> None:
        """Keep what a message holds. Raises StreamFault if it does not fit those before."""
        found, header = self.recording, block.header
        if name in SAMPLED:
            self._append(name, block)
        elif name.startswith("events/"):
            if len(found.events) >= MOST_EVENTS:
                raise StreamFault(f"there are more than {MOST_EVENTS} events")
            # Not ToNanoseconds(): it refuses times beyond the calendar.
            time_ns = header.timestamp.seconds * 1_000_000_000 + header.timestamp.nanos
            publisher = sys.intern(header.name)
            data = event_data(header)
            found.events.append(Event(time_ns, publisher, header.level, header.message, data))
        elif name.startswith("end/"):
            found.ends[header.role] = header
        elif name == "scene":
            self._announced_toml = header.scene_toml
        elif name == "pacing":
            found.pacing = block
        elif name == "balance":
            found.balance = header

    def _append(self, name: str, block: DecodedBlock) -> None:
        header: Any = block.header
        stream: SampledStream = getattr(self.recording, name)
        columns, arrays = self._columns[name], {k: v for k, v in block.arrays.items() if len(v)}
        if flags := getattr(header, "saturated", b""):
            arrays["saturated"] = np.frombuffer(flags, np.uint8)
        if columns and arrays and set(arrays) != set(columns):
            raise StreamFault(
                f"stream '{name}' sequence {header.sequence} has the fields {sorted(arrays)}, "
                f"those before {sorted(columns)}"
            )
        stream.messages += 1
        for label in ("step_ns", "every_steps", "scale", "offset"):
            setattr(stream, label, getattr(header, label, getattr(stream, label)))
        for label, values in arrays.items():
            columns.setdefault(label, (values.dtype, bytearray()))[1].extend(values.tobytes())

    def join(self) -> None:
        """Complete the streams of the recording, after its last record."""
        for name, columns in self._columns.items():
            stream: SampledStream = getattr(self.recording, name)
            for label, (dtype, data) in columns.items():
                stream.arrays[label] = np.frombuffer(data, dtype)

    def compare_with_hello(self) -> None:
        """Report where the hello contradicts scene and description; fill in what the file lacks."""
        hello, found = self.checker.announced, self.recording
        if hello is None:
            return
        described, scene_toml = run_metadata(hello), self._announced_toml or hello.scene_toml
        if not found.scene_toml:
            self.report("the scene is that of the hello: the file has no other")
            found.scene_toml = scene_toml
        elif found.scene_toml != scene_toml:
            self.report("the hello has another scene than the file")
        if not found.metadata:
            self.report("the description of the run is that of the hello")
            found.metadata = described
        for key in sorted(set(found.metadata) & set(described)):
            if found.metadata[key] != described[key]:
                self.report(
                    f"{key} is '{found.metadata[key][:40]}' in the file's description, "
                    f"'{described[key][:40]}' in the hello"
                )

    def reconcile(self) -> None:
        """Report where the counts that the roles announced, or the length of the run, do not
        fit."""
        found = self.recording
        for role in (PLANT, CONTROLLER):
            if role not in found.ends:
                self.report(f"the {role} announced no end: counts cannot be reconciled")
                continue
            try:
                self.checker.reconcile(found.ends[role])
            except StreamFault as error:
                self.report(str(error))
        text = found.metadata.get("steps", "0")
        end_step = found.truth.end_step
        steps = int(text) if text.isdecimal() and len(text) < _DIGITS else -1
        if steps < 0:
            self.report(f"the length of the run cannot be read: '{text[:40]}'")
        elif end_step < steps:
            self.report(f"readable to step {end_step:,} of {steps:,} announced")
        elif end_step > steps and "steps" in found.metadata:
            self.report(f"stream 'truth' goes on to step {end_step:,} of {steps:,}")


def _stream_of(topic: str, payload: bytes) -> str:
    """Return the stream of a message, by its publisher. Raises MessageError."""
    kind = next(s.name for s in streams.STREAMS.values() if s.topic == topic)
    header: Any = codec.decoded(Envelope(kind, payload)).header
    publisher = header.name if topic == "/events" else header.role
    # A controller of the user may call itself by any name.
    return f"{topic[1:]}/{PLANT if publisher == PLANT else CONTROLLER}"
