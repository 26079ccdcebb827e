"""Checks of incoming messages, so that no loss passes silently: run, number, continuity, counts."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import zip_longest
from typing import Any

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message

from hertzloop.bus import messages_pb2 as messages
from hertzloop.bus.codec import DecodedBlock, MessageError, decoded, sample_count
from hertzloop.bus.messages_pb2 import ControllerReport, DaqBlock, Hello, RunEnd, StreamCount
from hertzloop.bus.streams import (
    CONTROLLER,
    LAST_NS,
    RECORDER,
    STREAMS,
    SUBSCRIPTIONS,
    Envelope,
    StreamFault,
)
from hertzloop.common.version import __version__

_LONGEST_VERSION = 20  # characters: it comes from another process
# A promise that no sample can break has no level; a plate without modes has no estimate.
_ALLOWED = {"trigger_level": -math.inf, "expected_error": math.inf}


@dataclass
class Counter:
    """Messages and samples of one stream so far."""

    messages: int = 0
    samples: int = 0


@dataclass
class SequenceChecker:
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
        """A hello says what is run, and for how long."""
        if not hello.scene_toml:
            raise StreamFault("the plant announced a run without a scene")
        if not 0 < hello.steps * hello.step_ns <= LAST_NS:
            raise StreamFault(
                f"the plant announced a run of {hello.steps} steps of {hello.step_ns} ns; it has "
                f"1 step or more and lasts {LAST_NS} ns at most"
            )
        self.announced = hello

    def _check_event(self, name: str, sequence: int | None, event: messages.Event) -> None:
        time_ns = event.timestamp.seconds * 10**9 + event.timestamp.nanos
        if not 0 <= time_ns <= LAST_NS or not 0 <= event.timestamp.nanos < 10**9:
            raise StreamFault(
                f"stream '{name}' sequence {sequence} has an event at {event.timestamp.seconds} s "
                f"and {event.timestamp.nanos} ns, which is no time of a run"
            )

    def reconcile(self, end: RunEnd) -> None:
        """Compare what a role announced at its end with what came: counts, 0 of a stream that it
        does not name, and after a run without fault what the controller worked by. Raises
        StreamFault."""
        counts = {one.stream: one for one in end.count}
        for name in SUBSCRIPTIONS[self.role]:
            if STREAMS[name].publisher != end.role or name == f"end/{end.role}":
                continue
            announced, came = counts.get(name, StreamCount()), self.counters.get(name, Counter())
            if (came.messages, came.samples) != (announced.messages, announced.samples):
                raise StreamFault(
                    f"stream '{name}' is incomplete: {announced.messages} messages "
                    f"with {announced.samples} samples were announced, {came.messages} with "
                    f"{came.samples} came"
                )
        if end.role == CONTROLLER and not end.fault and self.announced:
            compare_report(self.announced, end.report)


def refuse_not_finite(
    stream: str, sequence: int | None, header: Message, arrays: Mapping[str, np.ndarray]
) -> None:
    """Raise StreamFault if a message holds a number that is infinite or none."""
    found = not_finite(header, arrays)
    if found:
        raise StreamFault(
            f"stream '{stream}' sequence {sequence} holds {found}; every number of a run is finite"
        )


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


def compare_report(announced: Hello, ran: ControllerReport) -> None:
    """Raise StreamFault unless the controller worked by the scene that the plant announced; with
    both versions if it is of another one."""
    try:
        _compare_report(announced, ran)
    except StreamFault as error:
        raise StreamFault(f"{error}{other_version(ran.versions, 'the controller is')}") from error


def _compare_report(announced: Hello, ran: ControllerReport) -> None:
    if not ran.scene_toml:  # it has no copy of its own
        return
    for stated, done in zip_longest(
        announced.scene_toml.splitlines(), ran.scene_toml.splitlines(), fillvalue="nothing"
    ):
        if stated != done:
            raise StreamFault(
                f"the controller used another scene: '{done[:100]}' where the plant "
                f"announced '{stated[:100]}'"
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
        stated = json.loads(versions)["hertzloop"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ""
    if not isinstance(stated, str) or stated == __version__:
        return ""
    shown = "".join(c for c in stated if c.isprintable())[:_LONGEST_VERSION]
    return f" ({who} hertzloop {shown}, this is {__version__})"
