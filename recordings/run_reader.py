"""Reader of the records of a recording: what belongs to the run, and what is wrong with it."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata

from hertzloop.bus import codec, sequence_checker, streams
from hertzloop.bus.codec import DecodedBlock, MessageError
from hertzloop.bus.messages_pb2 import EnergyBalance, Hello, RunEnd
from hertzloop.bus.sequence_checker import not_finite
from hertzloop.recordings.file_format import (
    LAW_ATTACHMENT,
    RESULT_METADATA,
    RUN_METADATA,
    SCENE_ATTACHMENT,
    TOPICS,
)
from hertzloop.recordings.joined_stream import Arrays
from hertzloop.recordings.mcap_records import (
    CorruptRecord,
    McapRecord,
    inner_records,
    message_of,
    parsed,
)
from hertzloop.recordings.recording import SAMPLED, Event, event_data
from hertzloop.recordings.stream_assembler import RejectedMessage, StreamAssembler

MOST_EVENTS = 1_000_000  # a sphere at rest: 130 000 in 20 million steps
MOST_TEXT = 200_000_000  # characters of all events together
_MOST_PROBLEMS = 40
OTHER_EVENTS = "events"  # stream of events whose publisher is not a role
_STREAM_OF_TOPIC = {
    topic: next(s for s in streams.STREAMS.values() if s.topic == topic) for topic in TOPICS
}


class StreamMessage(NamedTuple):
    """A message that belongs to the run: its stream, the message as recorded, and its arrays."""

    stream: str
    message: Message
    arrays: Arrays


@dataclass
class RunReader:
    """Reads the records of a file one by one, and keeps what belongs to the run.

    Attributes:
        channels: Topics by channel.
        unnamed_channels: Whether `channels` was guessed, since the file does not say it.
        keep: Whether samples of streams that are short enough stay in memory.
        only: The topic to read; "" for all.
        run_id: Run to which all messages belong; 0 if the first one decides.
        scene_toml: The scene; empty without one.
        law_source: Text of the law; empty without one.
        metadata: Description of the run; None without one.
        result: Result of the run; None without one.
        hello: First message of the plant; None without one.
        announced_toml: The whole scene, if the hello leaves out some of it.
        balance: Energy and momentum balance; None without one.
        pacing: Response times; None without them.
        ends: Final messages by role.
        events: Events in the order of the file.
        counters: Messages and samples by stream.
        problems: Sentences on what is missing or does not belong to the run.
        unknown_channels: Channels without a topic.
        others: Number of messages of other topics.
        assemblers: The streams of samples.
        first: Number of the first message of each stream in the latest record.
        out_of_place: Whether a message came after a later one of its stream.
    """

    channels: dict[int, str] = field(default_factory=dict)
    unnamed_channels: bool = False
    keep: bool = False
    only: str = ""
    run_id: int = 0
    scene_toml: str = ""
    law_source: str = ""
    metadata: dict[str, str] | None = None
    result: dict[str, str] | None = None
    hello: Hello | None = None
    announced_toml: str = ""
    balance: EnergyBalance | None = None
    pacing: DecodedBlock | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    counters: dict[str, sequence_checker.Counter] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    unknown_channels: set[int] = field(default_factory=set)
    others: int = 0
    assemblers: dict[str, StreamAssembler] = field(init=False)
    first: dict[str, int] = field(default_factory=dict)
    out_of_place: bool = False
    _text: int = 0  # characters of the events
    _second_scene: bool = False
    _next: dict[str, int] = field(default_factory=dict)
    _highest: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.assemblers = {
            name: StreamAssembler(name, [] if self.keep else None) for name in SAMPLED
        }

    def messages_in(self, record: McapRecord) -> Iterator[StreamMessage]:
        """Yield the messages in a record that belong to the run."""
        self.first = {}
        try:
            if record.opcode == Opcode.ATTACHMENT:
                self._attachment(parsed(Attachment, record.content, "Attachment"))
            elif record.opcode == Opcode.METADATA:
                self._metadata(parsed(Metadata, record.content, "Metadata"))
            elif record.opcode == Opcode.CHUNK:
                for opcode, content in inner_records(record.content):
                    yield from self._inner(opcode, content)
            else:
                yield from self._inner(record.opcode, record.content)
        except CorruptRecord as error:
            self.report(f"the file is cut off or damaged (byte {record.at}: {error})")

    def report(self, sentence: str) -> None:
        """Add to `problems`, unless there are too many."""
        if len(self.problems) < _MOST_PROBLEMS:
            self.problems.append(sentence)
        elif len(self.problems) == _MOST_PROBLEMS:
            self.problems.append("and more problems of this kind")

    def _attachment(self, attachment: Attachment) -> None:
        if attachment.name == LAW_ATTACHMENT:
            self.law_source = self.law_source or attachment.data.decode(errors="replace")
        if attachment.name != SCENE_ATTACHMENT:
            return
        if self.scene_toml:
            self._second_scene = True
            self.report("there is a second scene; the first is used")
            return
        try:
            self.scene_toml = attachment.data.decode()
        except UnicodeDecodeError as error:
            raise CorruptRecord("the scene is not text") from error

    def _metadata(self, metadata: Metadata) -> None:
        if metadata.name == RUN_METADATA:
            if self.metadata is None:
                self.metadata = dict(metadata.metadata)
                try:
                    self.run_id = int(self.metadata.get("run_id", "0"), 16)
                except ValueError:
                    self.report("the run's id cannot be read")
            elif not self._second_scene:  # a second run has both; one problem is enough
                self.report("there is a second description of the run; the first is used")
        elif metadata.name == RESULT_METADATA:
            if self.result is not None:
                self.report("there is a second result of the run; the first is used")
            else:
                self.result = dict(metadata.metadata)

    def _inner(self, opcode: int, content: bytes) -> Iterator[StreamMessage]:
        if opcode == Opcode.CHANNEL:
            channel = parsed(Channel, content, "a channel")
            self.channels[channel.id] = channel.topic
        elif opcode == Opcode.MESSAGE:
            message = message_of(content)
            topic = self.channels.get(message.channel_id)
            if topic is None:
                self.unknown_channels.add(message.channel_id)
            elif topic not in _STREAM_OF_TOPIC:
                self.others += 1
            elif not self.only or topic == self.only:
                yield from self._message(topic, message)

    def _message(self, topic: str, message: Message) -> Iterator[StreamMessage]:
        name = topic[1:]
        try:
            block = codec.decoded(streams.Envelope(_STREAM_OF_TOPIC[topic].name, message.data))
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
                self.run_id = self.run_id or header.run_id
                if header.run_id != self.run_id:
                    raise RejectedMessage(
                        f"it belongs to run {header.run_id:x}, not to {self.run_id:x}"
                    )
            if name != OTHER_EVENTS:  # note where in its stream the message belongs
                number = getattr(header, "sequence", message.sequence)
                self.first.setdefault(name, number)
                self.out_of_place |= number < self._highest.get(name, 0)
                self._highest[name] = max(number, self._highest.get(name, 0))
            if name in self.assemblers:
                arrays, problem = self.assemblers[name].add(block, message)
            else:
                arrays, problem = {}, self._single(name, header, message)
                if name == "pacing":
                    self.pacing = block
        except (MessageError, RejectedMessage) as error:
            self.report(f"a message of stream '{name[:40]}' is ignored: {error}")
            return
        if problem:
            self.report(problem)
        counter = self.counters.setdefault(name, sequence_checker.Counter())
        counter.messages += 1
        counter.samples += codec.sample_count(block)
        yield StreamMessage(
            name if name in streams.STREAMS else _STREAM_OF_TOPIC[topic].name, message, arrays
        )

    def _single(self, name: str, header: Any, message: Message) -> str:
        """Keep a message without samples; return a sentence on what is missing before it."""
        expected = self._next.get(name, 0)
        if name == OTHER_EVENTS:
            self._event(header, message)
            return ""
        if message.sequence < expected:
            raise RejectedMessage(f"number {message.sequence} is repeated")
        if streams.STREAMS[name].once and self.counters.get(name):
            raise RejectedMessage("there is a second one; the first is used")
        self._next[name] = message.sequence + 1
        if name == "hello":
            self.hello = header
        elif name == "scene":
            self.announced_toml = header.scene_toml
        elif name == "balance":
            self.balance = header
            if wrong := not_finite(header, {}):
                return f"the energy balance holds {wrong}, which is not finite"
        elif name.startswith("end/"):
            self.ends[header.role] = header
        elif name.startswith("events/"):
            self._event(header, message)
        if message.sequence > expected:
            return f"stream '{name}': number {message.sequence} follows where {expected} was due"
        return ""

    def _event(self, log: Any, message: Message) -> None:
        # Not ToNanoseconds(): it refuses times beyond the calendar.
        time_ns = log.timestamp.seconds * 1_000_000_000 + log.timestamp.nanos
        if time_ns != message.log_time or time_ns > streams.LAST_NS:
            raise RejectedMessage(f"an event of {time_ns} ns is recorded at {message.log_time} ns")
        if len(self.events) >= MOST_EVENTS:
            raise RejectedMessage(f"there are more than {MOST_EVENTS} events")
        self._text += len(log.message) + len(log.name) + len(log.quantity)
        if self._text > MOST_TEXT:
            raise RejectedMessage(f"the events have more than {MOST_TEXT} characters")
        name = sys.intern(log.name)
        self.events.append(Event(time_ns, name, log.level, log.message, event_data(log)))
