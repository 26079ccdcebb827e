"""The one table of streams, and the book-keeping that lets no loss pass silently."""

from dataclasses import dataclass, field
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from bus import wire
from bus.messages_pb2 import Books, DaqBlock, ForceBlock, Hello, RunEnd, TruthBlock

PLANT, CONTROLLER, RECORDER = "plant", "controller", "recorder"


@dataclass(frozen=True)
class Stream:
    """One numbered sequence of messages from one role."""

    name: str
    publisher: str
    message: type[Message]
    topic: str  # in the recording
    compared: bool = False  # its samples must be the same in every repeat of a run


STREAMS = {
    s.name: s
    for s in (
        Stream("hello", PLANT, Hello, "/hello"),
        Stream("daq", PLANT, DaqBlock, "/daq", compared=True),
        Stream("truth", PLANT, TruthBlock, "/truth", compared=True),
        Stream("force", CONTROLLER, ForceBlock, "/force", compared=True),
        Stream("events/plant", PLANT, Log, "/events", compared=True),
        Stream("events/controller", CONTROLLER, Log, "/events", compared=True),
        Stream("books", PLANT, Books, "/books"),
        Stream("end/plant", PLANT, RunEnd, "/end"),
        Stream("end/controller", CONTROLLER, RunEnd, "/end"),
    )
}

# What each role hears.
SUBSCRIPTIONS = {
    PLANT: ("force", "end/controller"),
    CONTROLLER: ("hello", "daq", "end/plant"),
    RECORDER: tuple(STREAMS),
}


@dataclass(frozen=True)
class Envelope:
    """A message as a port delivers it.

    `sequence` counts from 0 in its stream; None where the payload's header says it.
    """

    stream: str
    payload: bytes
    sequence: int | None = None


class StreamFault(RuntimeError):
    """A stream has a gap, a repeat, a foreign or a malformed message."""


@dataclass
class Counter:
    """Messages and samples of one stream so far."""

    messages: int = 0
    samples: int = 0


def sample_count(block: wire.Packed) -> int:
    """Number of samples in a decoded block; a message without arrays counts as one."""
    return max((len(a) for a in block.arrays.values()), default=1)


def decode(envelope: Envelope) -> wire.Packed:
    """Decode any stream's message. Raises wire.MessageError if it is malformed."""
    stream = STREAMS[envelope.stream]
    return wire.decode(stream.message, envelope.payload)


def has_header_sequence(stream: str) -> bool:
    """Whether the messages of a stream carry their own sequence number."""
    return "sequence" in STREAMS[stream].message.DESCRIPTOR.fields_by_name


@dataclass
class Checker:
    """Follows incoming streams: run, numbering and continuity of every block.

    The run and the length of a step are fixed by the first message that carries them.
    """

    run_id: int = 0
    step_ns: int = 0
    counters: dict[str, Counter] = field(default_factory=dict)
    next_step: dict[str, int] = field(default_factory=dict)
    scales: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def accept(self, envelope: Envelope) -> wire.Packed:
        """Decode and check one message. Raises StreamFault on anything out of order."""
        name = envelope.stream
        counter = self.counters.setdefault(name, Counter())
        try:
            block = decode(envelope)
        except wire.MessageError as error:
            raise StreamFault(
                f"malformed message on stream '{name}' where sequence {counter.messages} "
                f"was expected: {error}"
            ) from error
        header: Any = block.header
        sequence = getattr(header, "sequence", envelope.sequence)
        if hasattr(header, "run_id"):
            self.run_id = self.run_id or header.run_id
            if header.run_id != self.run_id:
                raise StreamFault(
                    f"stream '{name}' sequence {sequence} belongs to run {header.run_id:x}, "
                    f"not to {self.run_id:x}: two runs share one name on the bus"
                )
        if sequence is not None and sequence != counter.messages:
            what = "repeat" if sequence < counter.messages else "gap"
            raise StreamFault(
                f"{what} on stream '{name}': sequence {sequence} came, "
                f"{counter.messages} was expected"
            )
        count = sample_count(block)
        if hasattr(header, "step_ns"):
            self.step_ns = self.step_ns or header.step_ns
            if header.step_ns != self.step_ns or not header.step_ns:
                raise StreamFault(
                    f"stream '{name}' sequence {sequence} has steps of {header.step_ns} ns, "
                    f"announced were {self.step_ns} ns"
                )
        if isinstance(header, DaqBlock):
            self._check_channel(name, header, count)
        if hasattr(header, "first_step"):
            expected = self.next_step.get(name, 0)
            if header.first_step != expected:
                raise StreamFault(
                    f"stream '{name}' sequence {sequence} starts at step {header.first_step}, "
                    f"expected {expected}"
                )
            every = getattr(header, "every_steps", 1)
            self.next_step[name] = expected + count * every
        counter.messages += 1
        counter.samples += count
        return block

    def _check_channel(self, name: str, header: DaqBlock, count: int) -> None:
        """A channel stays as its first block describes it, with a flag a sample or none."""
        scale = (header.every_steps, header.scale, header.offset)
        before = self.scales.setdefault(name, scale)
        if scale != before or header.every_steps < 1:
            raise StreamFault(
                f"stream '{name}' sequence {header.sequence} has (every_steps, scale, offset) = "
                f"{scale}, its first block {before}"
            )
        if len(header.saturated) not in (0, count):
            raise StreamFault(
                f"stream '{name}' sequence {header.sequence} has {len(header.saturated)} flags "
                f"for {count} samples"
            )

    def reconcile(self, end: RunEnd) -> None:
        """Compare a role's announced counts with what came. Raises StreamFault."""
        missing = set(self.counters) - {announced.stream for announced in end.count}
        for name in sorted(missing - {f"end/{end.role}"}):
            if STREAMS[name].publisher == end.role:
                raise StreamFault(f"the {end.role} announced no count for stream '{name}'")
        for announced in end.count:
            came = self.counters.get(announced.stream, Counter())
            if (came.messages, came.samples) != (announced.messages, announced.samples):
                raise StreamFault(
                    f"stream '{announced.stream}' lost its tail: {announced.messages} messages "
                    f"with {announced.samples} samples were announced, {came.messages} with "
                    f"{came.samples} came"
                )
