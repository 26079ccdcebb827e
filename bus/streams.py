"""The one table of streams, their messages in protobuf wire format, and the book-keeping that lets
no loss pass silently.

A protobuf message may be written as the concatenation of its parts, so the scalar fields go through
the protobuf library and every array is appended as one packed field: tag, length, raw little-endian
values. Any protobuf reader decodes the result; reading a block of 1000 samples costs microseconds.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from itertools import zip_longest
from typing import Any, NamedTuple, TypeVar

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import DecodeError, Message

from hertzloop.bus import messages_pb2 as messages
from hertzloop.bus.messages_pb2 import DaqBlock, Hello, RunEnd, SetUp

PLANT, CONTROLLER, RECORDER = ROLES = "plant", "controller", "recorder"
_LONGEST_VERSION = 20  # characters: it comes from another process
LAST_NS = 2**63 - 1  # simulated time that every reader of a recording can hold


@dataclass(frozen=True)
class Stream:
    """One numbered sequence of messages from one role; `heard` by which, beside the recorder."""

    name: str
    publisher: str
    message: type[Message]
    topic: str  # in the recording
    heard: str = ""
    compared: bool = False  # its samples must be the same in every repeat of a run
    once: bool = False  # one message a run
    recorded_as: type[Message] | None = None  # schema in the recording, if another
    numbered: bool = field(init=False)  # whether its messages carry their own sequence number

    def __post_init__(self) -> None:
        vars(self)["numbered"] = "sequence" in self.message.DESCRIPTOR.fields_by_name


STREAMS = {
    s.name: s
    for s in (
        Stream("hello", PLANT, messages.Hello, "/hello", CONTROLLER, once=True),
        Stream("law", PLANT, messages.LawText, "/law", once=True),
        Stream("daq", PLANT, messages.DaqBlock, "/daq", CONTROLLER, compared=True),
        Stream("truth", PLANT, messages.TruthBlock, "/truth", compared=True),
        Stream("force", CONTROLLER, messages.ForceBlock, "/force", PLANT, compared=True),
        Stream("events/plant", PLANT, messages.Event, "/events", compared=True, recorded_as=Log),
        Stream(
            "events/controller",
            CONTROLLER,
            messages.Event,
            "/events",
            compared=True,
            recorded_as=Log,
        ),
        Stream("books", PLANT, messages.Books, "/books", once=True),
        Stream("end/plant", PLANT, messages.RunEnd, "/end", CONTROLLER, once=True),
        Stream("end/controller", CONTROLLER, messages.RunEnd, "/end", PLANT, once=True),
        Stream("pacing", PLANT, messages.Pacing, "/pacing", once=True),
        Stream("scene", PLANT, messages.SceneText, "/scene", CONTROLLER, once=True),
    )
}

# What each role hears.
SUBSCRIPTIONS = {
    PLANT: tuple(s.name for s in STREAMS.values() if s.heard == PLANT),
    CONTROLLER: tuple(s.name for s in STREAMS.values() if s.heard == CONTROLLER),
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
    """A stream has a gap, a repeat, a malformed message or a message of another run.

    The message names the stream and the sequence number.
    """

    exit_status = 1


@dataclass
class Counter:
    """Messages and samples of one stream so far."""

    messages: int = 0
    samples: int = 0


_DTYPES: dict[int, np.dtype[Any]] = {
    FieldDescriptor.TYPE_DOUBLE: np.dtype("<f8"),
    FieldDescriptor.TYPE_FLOAT: np.dtype("<f4"),
    FieldDescriptor.TYPE_SFIXED32: np.dtype("<i4"),
}
_LENGTH_DELIMITED = 2
_FIXED_WIDTHS = {1: 8, 5: 4}  # wire type -> bytes
_WIRE_TYPES = {  # of a scalar field; all others are varints, wire type 0
    FieldDescriptor.TYPE_DOUBLE: 1,
    FieldDescriptor.TYPE_FIXED64: 1,
    FieldDescriptor.TYPE_SFIXED64: 1,
    FieldDescriptor.TYPE_FLOAT: 5,
    FieldDescriptor.TYPE_FIXED32: 5,
    FieldDescriptor.TYPE_SFIXED32: 5,
    FieldDescriptor.TYPE_STRING: _LENGTH_DELIMITED,
    FieldDescriptor.TYPE_BYTES: _LENGTH_DELIMITED,
    FieldDescriptor.TYPE_MESSAGE: _LENGTH_DELIMITED,
}
# A promise that no sample can break has no level; a plate without modes has no estimate.
_ALLOWED = {"promise_level": -math.inf, "expected_error": math.inf}

M = TypeVar("M", bound=Message)


class MessageError(ValueError):
    """A payload is not the message it should be."""


class DecodedBlock(NamedTuple):
    """A decoded block: scalar fields in `header`, arrays by field name."""

    header: Any
    arrays: dict[str, np.ndarray]


class _Layout(NamedTuple):
    """Fields of a message type: arrays as in `array_fields`, and the wire type of every
    number; repeated fields are packed."""

    arrays: dict[str, tuple[int, np.dtype]]
    wire_types: dict[int, int]


@cache
def _layout(descriptor: Descriptor) -> _Layout:
    return _Layout(
        arrays={
            field.name: (field.number, _DTYPES[field.type])
            for field in descriptor.fields
            if field.is_repeated and field.type in _DTYPES
        },
        wire_types={
            field.number: _LENGTH_DELIMITED if field.is_repeated else _WIRE_TYPES.get(field.type, 0)
            for field in descriptor.fields
        },
    )


def array_fields(message_class: type[Message]) -> dict[str, tuple[int, np.dtype]]:
    """Field name -> (field number, dtype) of the packed arrays of a message type."""
    return _layout(message_class.DESCRIPTOR).arrays


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def encode(header: Message, **arrays: np.ndarray) -> bytes:
    """Serialise `header` with `arrays` (1-D, by field name); empty arrays are left out.

    Raises KeyError for a name that is not an array field of the message.
    """
    fields = array_fields(type(header))
    parts = [header.SerializeToString()]
    for name, values in arrays.items():
        number, dtype = fields[name]
        raw = np.ascontiguousarray(values, dtype=dtype).tobytes()
        if raw:
            parts += [_varint(number << 3 | _LENGTH_DELIMITED), _varint(len(raw)), raw]
    return b"".join(parts)


def _read_varint(payload: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 64:
        byte = payload[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
    raise MessageError("a number in it is longer than 64 bits")


def _split(
    payload: memoryview, wire_types: dict[int, int], wanted: set[int]
) -> tuple[bytes, dict[int, memoryview]]:
    """Separate the fields in `wanted`, each at most once, from the rest of a payload.

    The protobuf library passes over a field that the message type does not have; here it
    means that the payload is something else.
    """
    rest: list[memoryview] = []
    found: dict[int, memoryview] = {}
    at, end = 0, len(payload)
    while at < end:
        start = at
        tag, at = _read_varint(payload, at)
        number, wire_type = tag >> 3, tag & 7
        if wire_types.get(number) != wire_type:
            raise MessageError(f"it has no field {number} of wire type {wire_type}")
        body = at
        if wire_type == 0:
            _, at = _read_varint(payload, at)
        elif wire_type in _FIXED_WIDTHS:
            at += _FIXED_WIDTHS[wire_type]
        else:
            length, body = _read_varint(payload, at)
            at = body + length
        if at > end:
            raise MessageError(f"field {number} runs {at - end} bytes past the end")
        if number in found:
            raise MessageError(f"field {number} comes twice")
        if number in wanted:
            found[number] = payload[body:at]
        else:
            rest.append(payload[start:at])
    return b"".join(rest), found


def decode(message_class: type[M], payload: bytes) -> DecodedBlock:
    """Read a block message; arrays are views of the payload, absent ones are empty.

    Raises MessageError when the payload is not a whole message of this type or
    when its arrays differ in length.
    """
    fields, wire_types = _layout(message_class.DESCRIPTOR)
    arrays = {name: np.empty(0, dtype) for name, (_, dtype) in fields.items()}
    names = {number: name for name, (number, _) in fields.items()}
    try:
        rest, found = _split(memoryview(payload), wire_types, set(names))
        for number, raw in found.items():
            arrays[names[number]] = np.frombuffer(raw, fields[names[number]][1])
        header = message_class()
        header.ParseFromString(rest)
    except (DecodeError, IndexError, ValueError) as error:
        raise MessageError(
            f"{len(payload)} bytes are not a {message_class.DESCRIPTOR.name}: {error}"
        ) from error
    lengths = {name: len(a) for name, a in arrays.items() if len(a)}
    if len(set(lengths.values())) > 1:
        raise MessageError(f"{message_class.DESCRIPTOR.name} has arrays of lengths {lengths}")
    return DecodedBlock(header, arrays)


@cache
def _doubles(descriptor: Descriptor) -> tuple[str, ...]:
    """Scalar fields of a message type that could hold a number that is not finite."""
    return tuple(
        field.name
        for field in descriptor.fields
        if field.type == FieldDescriptor.TYPE_DOUBLE and not field.is_repeated
    )


def not_finite(header: Any, arrays: Mapping[str, np.ndarray]) -> str:
    """Name, value and step of the first number that is not finite; "" if all are."""
    for name in _doubles(header.DESCRIPTOR):
        value = getattr(header, name)
        if not math.isfinite(value) and value != _ALLOWED.get(name):
            return f"{name} = {value:g}"
    for name, values in arrays.items():
        finite = np.isfinite(values)
        if not finite.all():
            i = int(np.argmin(finite))
            step = header.first_step + i * getattr(header, "every_steps", 1)
            return f"{name} = {values[i]:g} at step {step}"
    return ""


def decoded(envelope: Envelope) -> DecodedBlock:
    """Decode any stream's message. Raises MessageError if it is malformed."""
    return decode(STREAMS[envelope.stream].message, envelope.payload)


def sample_count(block: DecodedBlock) -> int:
    """Number of samples in a decoded block; a message without arrays counts as one."""
    return max((len(a) for a in block.arrays.values()), default=1)


def refuse_not_finite(
    stream: str, sequence: int | None, header: Message, arrays: Mapping[str, np.ndarray]
) -> None:
    """Raise StreamFault if a message holds a number that is infinite or none."""
    found = not_finite(header, arrays)
    if found:
        raise StreamFault(
            f"stream '{stream}' sequence {sequence} holds {found}; every number of a run is finite"
        )


@dataclass
class Checker:
    """Follows incoming streams of a role: run, numbering, continuity and numbers of every block.

    The run and the length of a step are fixed by the first message that carries them;
    `announced` is the plant's hello, as heard, or as sent by the plant itself.
    """

    run_id: int = 0
    step_ns: int = 0
    role: str = RECORDER
    announced: Hello | None = None
    counters: dict[str, Counter] = field(default_factory=dict)
    next_step: dict[str, int] = field(default_factory=dict)
    scales: dict[str, tuple[float, ...]] = field(default_factory=dict)
    latest_event_ns: int = 0

    def explained(self, error: StreamFault) -> StreamFault:
        """The same fault, with both versions if the plant is of another one."""
        versions = self.announced.versions if self.announced else ""
        return StreamFault(f"{error}{other_version(versions, 'the plant is')}")

    def accept(self, envelope: Envelope) -> DecodedBlock:
        """Decode and check one message. Raises StreamFault on anything out of order."""
        name = envelope.stream
        counter = self.counters.setdefault(name, Counter())
        try:
            block = decoded(envelope)
        except MessageError as error:
            raise StreamFault(
                f"malformed message on stream '{name}' where sequence {counter.messages} "
                f"was expected: {error}"
            ) from error
        header: Any = block.header
        sequence = getattr(header, "sequence", envelope.sequence)
        self._check_run(name, sequence, header)
        self._check_number(name, sequence, counter)
        count = sample_count(block)
        self._check_step(name, sequence, header)
        if isinstance(header, DaqBlock):
            self._check_channel(name, header, count)
        refuse_not_finite(name, sequence, header, block.arrays)
        if isinstance(header, Hello):
            self._check_length(header)
        elif isinstance(header, messages.Event):
            self._check_event(name, sequence, header)
        elif isinstance(header, RunEnd) and header.role != STREAMS[name].publisher:
            raise StreamFault(
                f"stream '{name}' carries the end of '{header.role}', not of the "
                f"{STREAMS[name].publisher}"
            )
        if hasattr(header, "first_step"):
            every = getattr(header, "every_steps", 1)
            self.next_step[name] = header.first_step + count * every
        counter.messages += 1
        counter.samples += count
        return block

    def _check_run(self, name: str, sequence: int | None, header: Any) -> None:
        if not hasattr(header, "run_id"):
            return
        self.run_id = self.run_id or header.run_id
        if header.run_id != self.run_id or not header.run_id:
            raise StreamFault(
                f"stream '{name}' sequence {sequence} belongs to run {header.run_id:x}, "
                f"not to {self.run_id:x}: two runs share one name on the bus"
            )

    def _check_number(self, name: str, sequence: int | None, counter: Counter) -> None:
        expected = counter.messages
        if sequence is None:
            raise StreamFault(
                f"a message without a number came on stream '{name}', {expected} was expected"
            )
        if sequence != expected:
            what = "repeat" if sequence < expected else "gap"
            raise StreamFault(
                f"{what} on stream '{name}': sequence {sequence} came, {expected} was expected"
            )
        if expected and STREAMS[name].once:
            raise StreamFault(
                f"a second message came on stream '{name}': a {STREAMS[name].publisher} sends "
                "one a run"
            )

    def _check_step(self, name: str, sequence: int | None, header: Any) -> None:
        if hasattr(header, "step_ns"):
            self.step_ns = self.step_ns or header.step_ns
            if header.step_ns != self.step_ns or not header.step_ns:
                raise StreamFault(
                    f"stream '{name}' sequence {sequence} has steps of {header.step_ns} ns, "
                    f"announced were {self.step_ns} ns"
                )
        if hasattr(header, "first_step"):
            expected = self.next_step.get(name, 0)
            if header.first_step != expected:
                raise StreamFault(
                    f"stream '{name}' sequence {sequence} starts at step {header.first_step}, "
                    f"expected {expected}"
                )

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

    def _check_length(self, hello: Hello) -> None:
        """A hello says what is run, and for how long; no event may lie beyond."""
        if not hello.scene_toml:
            raise StreamFault("the plant announced a run without a scene")
        if not 0 < hello.steps * hello.step_ns <= LAST_NS:
            raise StreamFault(
                f"the plant announced a run of {hello.steps} steps of {hello.step_ns} ns; it has "
                f"1 step or more and lasts {LAST_NS} ns at most"
            )
        self.announced = hello
        self._check_within(self.latest_event_ns)

    def _check_event(self, name: str, sequence: int | None, event: messages.Event) -> None:
        time_ns = event.timestamp.seconds * 10**9 + event.timestamp.nanos
        if not 0 <= time_ns <= LAST_NS or not 0 <= event.timestamp.nanos < 10**9:
            raise StreamFault(
                f"stream '{name}' sequence {sequence} has an event at {event.timestamp.seconds} s "
                f"and {event.timestamp.nanos} ns, which is no time of a run"
            )
        self.latest_event_ns = max(self.latest_event_ns, time_ns)
        self._check_within(time_ns)

    def _check_within(self, time_ns: int) -> None:
        """Events lie within the run; what came before its hello is looked at with it."""
        if self.announced and time_ns > (end := self.announced.steps * self.announced.step_ns):
            raise StreamFault(f"an event came for {time_ns} ns, the run ends at {end} ns")

    def reconcile(self, end: RunEnd) -> None:
        """Compare what a role announced at its end with what came: counts, and after a run
        without fault what the controller worked by. Raises StreamFault."""
        heard = {s for s in SUBSCRIPTIONS[self.role] if STREAMS[s].publisher == end.role}
        missing = heard - {announced.stream for announced in end.count} - {f"end/{end.role}"}
        for name in sorted(missing):
            raise StreamFault(f"the {end.role} announced no count for stream '{name}'")
        for announced in end.count:
            if announced.stream not in heard:
                continue
            came = self.counters.get(announced.stream, Counter())
            if (came.messages, came.samples) != (announced.messages, announced.samples):
                raise StreamFault(
                    f"stream '{announced.stream}' is incomplete: {announced.messages} messages "
                    f"with {announced.samples} samples were announced, {came.messages} with "
                    f"{came.samples} came"
                )
        if end.role == CONTROLLER and not end.fault and self.announced:
            compare_set_up(self.announced, end.set_up)


def compare_set_up(announced: Hello, ran: SetUp) -> None:
    """Raise StreamFault unless the controller worked by the scene that the plant announced; with
    both versions if it is of another one."""
    try:
        _compare_set_up(announced, ran)
    except StreamFault as error:
        raise StreamFault(f"{error}{other_version(ran.versions, 'the controller is')}") from error


def _compare_set_up(announced: Hello, ran: SetUp) -> None:
    if not ran.scene_toml:
        raise StreamFault("the final message of the controller names no scene")
    for said, done in zip_longest(
        announced.scene_toml.splitlines(), ran.scene_toml.splitlines(), fillvalue="nothing"
    ):
        if said != done:
            raise StreamFault(
                f"the controller used another scene: '{done[:100]}' where the plant "
                f"announced '{said[:100]}'"
            )
    if ran.stiffness != announced.stiffness:
        raise StreamFault(
            f"the controller worked with a contact stiffness of {ran.stiffness:g} N/m^1.5, "
            f"the plant announced {announced.stiffness:g}"
        )


def other_version(versions: str, who: str) -> str:
    """Both versions, in brackets, of the `versions` in a hello or a recording (JSON by package);
    empty where they are of this version, or say nothing."""
    try:
        said = json.loads(versions)["hertzloop"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ""
    here = version("hertzloop")
    if not isinstance(said, str) or said == here:
        return ""
    shown = "".join(c for c in said if c.isprintable())[:_LONGEST_VERSION]
    return f" ({who} hertzloop {shown}, this is {here})"
