"""What of a file's messages belongs to its run, in their order; the rest is named."""

import heapq
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from io import BytesIO
from itertools import pairwise
from typing import Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Message, Metadata

from hertzloop.bus import streams as bus_streams
from hertzloop.bus.events import MODES, Fact, fact_of
from hertzloop.bus.messages_pb2 import Books, EventKind, Hello, RunEnd
from hertzloop.bus.streams import CONTROLLER, LAST_NS, PLANT, STREAMS, Counter, Envelope
from hertzloop.bus.wire import DecodedBlock, MessageError, not_finite
from hertzloop.recordings.chunks import Damaged, McapRecord, channel_of, inner_records, message_of
from hertzloop.recordings.columns import SAMPLED, Arrays, Refused, Track
from hertzloop.recordings.writer import (
    LAW_ATTACHMENT,
    RESULT_METADATA,
    RUN_METADATA,
    SCENE_ATTACHMENT,
    TOPICS,
    described_by,
)

MOST_EVENTS = 1_000_000  # a sphere at rest: 130 000 in 20 million steps
MOST_TEXT = 200_000_000  # characters of all events together
_MOST_PROBLEMS = 40
_NAMELESS = "events"  # of a publisher that is no role
_KINDS = {topic: next(s for s in STREAMS.values() if s.topic == topic) for topic in TOPICS}


@dataclass(frozen=True, slots=True)
class Event:
    """Simulated time in ns, publisher ("plant", "controller"), level as in foxglove.Log, the
    sentence for people, and the fact for programs."""

    time_ns: int
    name: str
    level: int
    message: str
    fact: Fact = field(default=Fact(), repr=False)


class Taken(NamedTuple):
    """A message that belongs to the run: its stream, itself as recorded, and its arrays."""

    stream: str
    message: Message
    arrays: Arrays


@dataclass
class Intake:
    """Takes a file's records one by one; `problems` says in sentences what does not belong.

    `only` limits it to one topic, for another look at what was taken before.
    """

    channels: dict[int, str] = field(default_factory=dict)
    only: str = ""
    scene_toml: str = ""
    law_source: str = ""
    metadata: dict[str, str] | None = None
    result: dict[str, str] | None = None
    run_id: int = 0
    hello: Hello | None = None
    books: Books | None = None
    pacing: DecodedBlock | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    counters: dict[str, Counter] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    unknown_channels: set[int] = field(default_factory=set)
    unnamed_channels: bool = False  # what they carry is known from elsewhere
    others: int = 0  # messages of topics that are none of ours
    tracks: dict[str, Track] = field(default_factory=lambda: {n: Track(n) for n in SAMPLED})
    text: int = 0  # characters of the events
    first: dict[str, int] = field(default_factory=dict)  # numbers in the last record, by stream
    out_of_place: bool = False  # a message came after a later one of its stream
    keep: InitVar[bool] = False  # the samples of streams that are short enough
    _next: dict[str, int] = field(default_factory=dict)
    _highest: dict[str, int] = field(default_factory=dict)

    def __post_init__(self, keep: bool) -> None:
        for track in self.tracks.values():
            track.kept = [] if keep else None

    def take(self, record: McapRecord) -> Iterator[Taken]:
        """The messages in a record that belong to the run."""
        self.first = {}
        try:
            if record.opcode == Opcode.ATTACHMENT:
                self._attachment(_parsed(Attachment, record.content))
            elif record.opcode == Opcode.METADATA:
                self._metadata(_parsed(Metadata, record.content))
            elif record.opcode == Opcode.CHUNK:
                for opcode, content in inner_records(record.content):
                    yield from self._inner(opcode, content)
            else:
                yield from self._inner(record.opcode, record.content)
        except Damaged as error:
            self._problem(f"the file is cut off or damaged (byte {record.at}: {error})")

    def _problem(self, sentence: str) -> None:
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
            self._problem("there is a second scene; the first is used")
            return
        try:
            self.scene_toml = attachment.data.decode()
        except UnicodeDecodeError as error:
            raise Damaged("the scene is not text") from error

    def _metadata(self, metadata: Metadata) -> None:
        if metadata.name == RUN_METADATA:
            if self.metadata is None:
                self.metadata = dict(metadata.metadata)
                try:
                    self.run_id = int(self.metadata.get("run_id", "0"), 16)
                except ValueError:
                    self._problem("the run's id cannot be read")
            elif not any("a second scene" in problem for problem in self.problems):
                self._problem("there is a second description of the run; the first is used")
        elif metadata.name == RESULT_METADATA:
            if self.result is not None:
                self._problem("there is a second result of the run; the first is used")
            else:
                self.result = dict(metadata.metadata)

    def _inner(self, opcode: int, content: bytes) -> Iterator[Taken]:
        if opcode == Opcode.CHANNEL:
            channel = channel_of(content)
            self.channels[channel.id] = channel.topic
        elif opcode == Opcode.MESSAGE:
            message = message_of(content)
            topic = self.channels.get(message.channel_id)
            if topic is None:
                self.unknown_channels.add(message.channel_id)
            elif topic not in _KINDS:
                self.others += 1
            elif not self.only or topic == self.only:
                yield from self._message(topic, message)

    def _message(self, topic: str, message: Message) -> Iterator[Taken]:
        name = topic[1:]
        try:
            block = bus_streams.decode(Envelope(_KINDS[topic].name, message.data))
            header: Any = block.header
            if topic == "/events":
                # Whoever brings a controller may call it as he likes.
                name = f"events/{header.name}"
                name = name if name in STREAMS else _NAMELESS
            elif topic == "/end":
                name = f"end/{header.role}"
            if name not in STREAMS and name != _NAMELESS:
                raise Refused(f"'{name[:40]}' is not a stream of a run")
            if hasattr(header, "run_id"):
                self.run_id = self.run_id or header.run_id
                if header.run_id != self.run_id:
                    raise Refused(f"it belongs to run {header.run_id:x}, not to {self.run_id:x}")
            if name != _NAMELESS:
                self._numbered(name, getattr(header, "sequence", message.sequence))
            if name in self.tracks:
                arrays, problem = self.tracks[name].add(block, message)
            else:
                arrays, problem = {}, self._single(name, header, message)
                if name == "pacing":
                    self.pacing = block
        except (MessageError, Refused) as error:
            self._problem(f"a message of stream '{name[:40]}' is ignored: {error}")
            return
        if problem:
            self._problem(problem)
        counter = self.counters.setdefault(name, Counter())
        counter.messages += 1
        counter.samples += bus_streams.sample_count(block)
        yield Taken(name if name in STREAMS else _KINDS[topic].name, message, arrays)

    def _numbered(self, name: str, number: int) -> None:
        """Note where in its stream a message belongs."""
        self.first.setdefault(name, number)
        self.out_of_place |= number < self._highest.get(name, 0)
        self._highest[name] = max(number, self._highest.get(name, 0))

    def _single(self, name: str, header: Any, message: Message) -> str:
        """Keep a message that is no block; a sentence on what is missing before it."""
        expected = self._next.get(name, 0)
        if name == _NAMELESS:
            self._event(header, message)
            return ""
        if message.sequence < expected:
            raise Refused(f"number {message.sequence} is repeated")
        if STREAMS[name].once and self.counters.get(name):
            raise Refused("there is a second one; the first is used")
        self._next[name] = message.sequence + 1
        if name == "hello":
            self.hello = header
        elif name == "books":
            self.books = header
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
        # Not ToNanoseconds(): it refuses what is out of the calendar.
        told = log.timestamp.seconds * 1_000_000_000 + log.timestamp.nanos
        if told != message.log_time or told > LAST_NS:
            raise Refused(f"an event of {told} ns is recorded at {message.log_time} ns")
        if len(self.events) >= MOST_EVENTS:
            raise Refused(f"there are more than {MOST_EVENTS} events")
        self.text += len(log.message) + len(log.name) + len(log.quantity)
        if self.text > MOST_TEXT:
            raise Refused(f"the events have more than {MOST_TEXT} characters")
        fact = fact_of(log) if log.kind else older_fact(log.name, log.message)
        self.events.append(Event(told, sys.intern(log.name), log.level, log.message, fact))

    def reconcile(self) -> None:
        """Compare what came with what the roles announced, and with the length of the run."""
        for role in (PLANT, CONTROLLER):
            end = self.ends.get(role)
            if end is None:
                self._problem(f"the {role} announced no end: counts cannot be reconciled")
                continue
            announced = {count.stream: count for count in end.count}
            for name, stream in STREAMS.items():
                if stream.publisher == role and not name.startswith("end/"):
                    self._reconcile(role, name, announced.get(name))
        if _NAMELESS in self.counters and len(self.ends) > 1:
            self._reconcile_events()
        steps, truth = self._steps(), self.tracks["truth"]
        end_step = truth.next_step
        if end_step < steps:
            self._problem(f"stream 'truth' ends at step {end_step} of {steps}")
        elif end_step > steps and self.metadata and "steps" in self.metadata:
            self._problem(f"stream 'truth' goes on to step {end_step} of {steps}")
        if self.unknown_channels or self.unnamed_channels:
            self._problem("the file is cut off or damaged (it does not say what some messages are)")

    def _reconcile_events(self) -> None:
        """All events together, where some do not say which role's they are."""
        names = [name for name in STREAMS if STREAMS[name].topic == "/events"]
        here = sum(self.counters.get(n, Counter()).messages for n in [*names, _NAMELESS])
        announced = sum(
            count.messages for e in self.ends.values() for count in e.count if count.stream in names
        )
        if here != announced:
            self._problem(f"{here} events are here, {announced} were announced")

    def _reconcile(self, role: str, name: str, announced: Any) -> None:
        here = self.counters.get(name, Counter())
        if name.startswith("events/") and _NAMELESS in self.counters:
            return
        if announced is None:
            if here.messages:
                self._problem(f"the {role} announced no count for stream '{name}'")
        elif (here.messages, here.samples) != (announced.messages, announced.samples):
            self._problem(
                f"stream '{name}': {here.messages} messages with {here.samples} samples are "
                f"here, {announced.messages} with {announced.samples} were announced"
            )

    def _steps(self) -> int:
        """Length of the run, in steps."""
        text = (self.metadata or {}).get("steps", "0")
        try:
            steps = int(text)
        except ValueError:
            steps = -1
        if not 0 <= steps <= LAST_NS:
            self._problem(f"the length of the run cannot be read: '{text[:40]}'")
            return 0
        return steps

    def agree(self) -> None:
        """Fill what the hello says, too, and name where it says something else."""
        hello = self.hello
        if hello is None:
            return
        described = described_by(hello)
        if not self.scene_toml:
            self._problem("the scene is that of the hello: the file has no other")
            self.scene_toml = hello.scene_toml
        elif self.scene_toml != hello.scene_toml:
            self._problem("the hello has another scene than the file")
        if self.metadata is None:
            self._problem("the description of the run is that of the hello")
            self.metadata = described
        for key in sorted(set(self.metadata) & set(described)):
            if self.metadata[key] != described[key]:
                self._problem(
                    f"{key} is '{self.metadata[key][:40]}' in the file's description, "
                    f"'{described[key][:40]}' in the hello"
                )


def _parsed(kind: Any, content: bytes) -> Any:
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # whatever the library makes of lengths that mean nothing
        raise Damaged(f"{kind.__name__} cannot be read ({type(error).__name__})") from error


def in_order(numbers: Sequence[Mapping[str, int]]) -> list[int]:
    """Positions of parts so that the messages of every stream follow one another; else as they are.

    `numbers` has, for each part, the first number of every stream in it. Where no order suits all
    streams, as only a forged file has it, the part that comes first in the file is taken.
    """
    by_stream: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for position, first in enumerate(numbers):
        for stream, number in first.items():
            by_stream[stream].append((number, position))
    after: dict[int, list[int]] = defaultdict(list)
    waits = [0] * len(numbers)  # for how many others a part has to wait
    for of_stream in by_stream.values():
        of_stream.sort()
        for (_, position), (_, follows) in pairwise(of_stream):
            after[position].append(follows)
            waits[follows] += 1
    ready = [position for position, count in enumerate(waits) if not count]
    order: list[int] = []
    taken = [False] * len(numbers)
    first_left = 0
    while len(order) < len(numbers):
        if ready:
            position = heapq.heappop(ready)
        else:  # a circle
            while taken[first_left]:
                first_left += 1
            position = first_left
        if taken[position]:
            continue
        taken[position] = True
        order.append(position)
        for follows in after[position]:
            waits[follows] -= 1
            if not waits[follows]:
                heapq.heappush(ready, follows)
    return order


_OF_PLANT = (
    (EventKind.CONTACT_BEGAN, re.compile(r"contact (?P<number>[0-9]{1,18}) began")),
    (EventKind.CONTACT_ENDED, re.compile(r"contact (?P<number>[0-9]{1,18}) ended")),
    (EventKind.RANGE_LEFT, re.compile(r"(?P<quantity>\w+) left the converter's range")),
    (EventKind.RANGE_REGAINED, re.compile(r"(?P<quantity>\w+) is back in the converter's range")),
)
_LAW = re.compile(r"law (mode )?(\w+) -> (mode )?(\w+)(, .*)?")


def older_fact(name: str, message: str) -> Fact:
    """The fact in an event of an earlier version; of another sentence, that no more is known."""
    if name == "controller" and (change := _LAW.fullmatch(message)):
        before, mode = _mode(change[2]), _mode(change[4])
        if before is not None and mode is not None:
            return Fact(EventKind.LAW_MODE, mode_before=before, mode=mode)
    for kind, pattern in _OF_PLANT if name == "plant" else ():
        if found := pattern.fullmatch(message):
            said = found.groupdict()
            return Fact(kind, int(said.get("number", 0)), said.get("quantity", ""))
    return Fact()


def _mode(said: str) -> int | None:
    if said in MODES:
        return MODES.index(said)
    return int(said) if re.fullmatch(r"-?[0-9]{1,18}", said) else None
