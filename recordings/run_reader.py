"""What a recording says of its run, from the records of its file one after the other."""

import sys
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata

from hertzloop.bus import codec, sequence_checker, streams
from hertzloop.bus.codec import DecodedBlock, MessageError
from hertzloop.bus.messages_pb2 import Hello
from hertzloop.bus.sequence_checker import not_finite
from hertzloop.recordings.file_format import (
    LAW_ATTACHMENT,
    RESULT_METADATA,
    RUN_METADATA,
    SCENE_ATTACHMENT,
    TOPICS,
)
from hertzloop.recordings.recording import SAMPLED, Event, Recording, SampledStream, event_data

MOST_EVENTS = 1_000_000  # a sphere at rest: 130 000 in 20 million steps
MOST_TEXT = 200_000_000  # characters of all events together
_MOST_PROBLEMS = 40
OTHER_EVENTS = "events"  # stream of events whose publisher is not a role
_STREAM_OF_TOPIC = {
    topic: next(s for s in streams.STREAMS.values() if s.topic == topic) for topic in TOPICS
}


class RejectedMessage(Exception):
    """Why a message cannot be part of the run."""


class StreamMessage(NamedTuple):
    """A message that belongs to the run: its stream, and the message as recorded."""

    stream: str
    message: Message


@dataclass
class RunReader:
    """Reads records one by one, and fills in the recording with what belongs to the run.

    Attributes:
        recording: The recording so far; `join` completes its streams.
        hello: First message of the plant; None without one.
        announced_toml: The whole scene, if the hello leaves out some of it.
        counters: Messages and samples by stream.
        finished: Whether the file has a result of the run.
    """

    recording: Recording
    hello: Hello | None = None
    announced_toml: str = ""
    counters: dict[str, sequence_checker.Counter] = field(default_factory=dict)
    finished: bool = False
    _run_id: int = 0
    _channels: dict[int, str] = field(default_factory=dict)
    _next: dict[str, int] = field(default_factory=dict)  # step of a block, number of a message
    _ended: set[str] = field(default_factory=set)  # streams with a gap: what follows is not used
    _columns: dict[tuple[str, str], tuple[np.dtype, bytearray]] = field(default_factory=dict)
    _finite: set[str] = field(default_factory=lambda: set(SAMPLED))
    _text: int = 0  # characters of the events

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
            elif topic not in _STREAM_OF_TOPIC:
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
                return
            found.metadata = dict(metadata.metadata)
            try:
                self._run_id = int(found.metadata.get("run_id", "0"), 16)
            except ValueError:
                self.report("the run's id cannot be read")
        elif metadata.name == RESULT_METADATA:
            if self.finished:
                self.report("there is a second result of the run; the first is used")
            else:
                found.result, self.finished = dict(metadata.metadata), True

    def _message(self, topic: str, message: Message) -> StreamMessage | None:
        kind, name = _STREAM_OF_TOPIC[topic].name, topic[1:]
        try:
            block = codec.decoded(streams.Envelope(kind, message.data))
            header: Any = block.header
            if topic == "/events":
                # A controller of the user may call itself by any name.
                name = f"events/{header.name}"
                name = name if name in streams.STREAMS else OTHER_EVENTS
            elif topic == "/end":
                name = f"end/{header.role}"
            if name not in streams.STREAMS and name != OTHER_EVENTS:
                raise RejectedMessage(f"'{name[:40]}' is not a stream of a run")
            if hasattr(header, "run_id"):
                self._run_id = self._run_id or header.run_id
                if header.run_id != self._run_id:
                    raise RejectedMessage(
                        f"it belongs to run {header.run_id:x}, not to {self._run_id:x}"
                    )
            if name in self._ended:
                return None
            if name not in SAMPLED:
                self._single(name, block, message)
            elif not self._block(name, block, message):
                return None
        except (MessageError, RejectedMessage) as error:
            self.report(f"a message of stream '{name[:40]}' is ignored: {error}")
            return None
        counter = self.counters.setdefault(name, sequence_checker.Counter())
        counter.messages += 1
        counter.samples += codec.sample_count(block)
        return StreamMessage(name if name in streams.STREAMS else kind, message)

    def _single(self, name: str, block: DecodedBlock, message: Message) -> None:
        """Keep a message without samples, and report what is missing before it."""
        found, header = self.recording, block.header
        if name == OTHER_EVENTS:
            self._event(header, message)
            return
        expected = self._next.get(name, 0)
        if message.sequence < expected:
            raise RejectedMessage(f"number {message.sequence} is repeated")
        if streams.STREAMS[name].once and self.counters.get(name):
            raise RejectedMessage("there is a second one; the first is used")
        if name.startswith("events/"):
            self._event(header, message)
        elif name == "hello":
            self.hello = header
        elif name == "scene":
            self.announced_toml = header.scene_toml
        elif name == "pacing":
            found.pacing = block
        elif name.startswith("end/"):
            found.ends[header.role] = header
        elif name == "balance":
            found.balance = header
            if wrong := not_finite(header, {}):
                self.report(f"the energy balance holds {wrong}, which is not finite")
        self._next[name] = message.sequence + 1
        if message.sequence > expected:
            self.report(
                f"stream '{name}': number {message.sequence} follows where {expected} was due"
            )

    def _event(self, log: Any, message: Message) -> None:
        # Not ToNanoseconds(): it refuses times beyond the calendar.
        time_ns = log.timestamp.seconds * 1_000_000_000 + log.timestamp.nanos
        events = self.recording.events
        if time_ns != message.log_time or time_ns > streams.LAST_NS:
            raise RejectedMessage(f"an event of {time_ns} ns is recorded at {message.log_time} ns")
        if len(events) >= MOST_EVENTS:
            raise RejectedMessage(f"there are more than {MOST_EVENTS} events")
        self._text += len(log.message) + len(log.name) + len(log.quantity)
        if self._text > MOST_TEXT:
            raise RejectedMessage(f"the events have more than {MOST_TEXT} characters")
        name = sys.intern(log.name)
        events.append(Event(time_ns, name, log.level, log.message, event_data(log)))

    def _block(self, name: str, block: DecodedBlock, message: Message) -> bool:
        """Add a block of samples; whether it follows the one before it.

        Raises:
            RejectedMessage: it contradicts itself, its message or earlier blocks, or comes twice.
        """
        header: Any = block.header
        stream: SampledStream = getattr(self.recording, name)
        arrays = {label: values for label, values in block.arrays.items() if len(values)}
        if flags := getattr(header, "saturated", b""):
            arrays["saturated"] = np.frombuffer(flags, np.uint8)
        count = max(map(len, arrays.values()), default=0)
        every = getattr(header, "every_steps", 1)
        _check_block(header, message, every, arrays, count)
        due, step = stream.messages, self._next.get(name, 0)
        where = (
            f"sequence {header.sequence} at step {header.first_step} follows where sequence "
            f"{due} at step {step} was expected"
        )
        if header.sequence < due or header.first_step < step:
            raise RejectedMessage(where)
        if header.sequence > due or header.first_step > step:
            self.report(f"stream '{name}': {where}; it is not read on")
            self._ended.add(name)
            return False
        for label in ("step_ns", "every_steps", "scale", "offset"):
            before = getattr(stream, label)
            value = getattr(header, label, before)
            # As text: NaN equals itself there.
            if due and repr(value) != repr(before):
                raise RejectedMessage(f"its {label} is {value}, that of those before {before}")
            setattr(stream, label, value)
        known = {label for stream_name, label in self._columns if stream_name == name}
        if count and known and set(arrays) != known:
            raise RejectedMessage(f"its fields are {sorted(arrays)}, those before {sorted(known)}")
        stream.messages += 1
        self._next[name] = step + count * every
        for label, values in arrays.items():
            _, data = self._columns.setdefault((name, label), (values.dtype, bytearray()))
            data.extend(values.tobytes())
            if name in self._finite and values.dtype.kind == "f" and not np.isfinite(values).all():
                self._finite.discard(name)
                at = step + every * int(np.flatnonzero(~np.isfinite(values))[0])
                self.report(f"stream '{name}': {label} is not finite at step {at}")
        return True

    def join(self) -> None:
        """Complete the streams of the recording, after its last record."""
        for (name, label), (dtype, data) in self._columns.items():
            getattr(self.recording, name).arrays[label] = np.frombuffer(data, dtype)


def _check_block(
    header: Any, message: Message, every: int, arrays: dict[str, np.ndarray], count: int
) -> None:
    """Raise RejectedMessage if a block contradicts itself or its message."""
    if not header.step_ns or not every:
        raise RejectedMessage(
            f"its steps have {header.step_ns} ns, a sample comes every {every} steps"
        )
    if (header.first_step + count * every) * header.step_ns > streams.LAST_NS:
        raise RejectedMessage(f"it begins at step {header.first_step}, beyond any run")
    if message.log_time != header.first_step * header.step_ns:
        raise RejectedMessage(f"step {header.first_step} is recorded at {message.log_time} ns")
    if message.sequence != header.sequence & 0xFFFFFFFF:
        raise RejectedMessage(f"sequence {header.sequence} is recorded as {message.sequence}")
    if len({len(values) for values in arrays.values()}) > 1:
        lengths = {name: len(values) for name, values in arrays.items()}
        raise RejectedMessage(f"its arrays have the lengths {lengths}")
