"""What all ports share: faults, publishing with numbers and counts; and the in-process port."""

import secrets
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping

import numpy as np
from google.protobuf.message import Message

from hertzloop.bus import codec, sequence_checker, streams
from hertzloop.bus.messages_pb2 import ControllerReport, RunEnd, StreamCount
from hertzloop.common.protocols import Port


class BusError(RuntimeError):
    """A process is missing or was lost. The message names it."""

    exit_status = 1


class PeerLost(BusError):
    """A process that takes part in the run is gone, or never came, or is silent.

    `roles` are those that are missing, as far as known; `at_s` is when that was found, by a clock
    that all processes of a host share.
    """

    def __init__(self, sentence: str, *roles: str) -> None:
        super().__init__(sentence)
        self.roles = roles
        self.at_s = time.monotonic()


class EndedByOther(streams.StreamFault):
    """Another role announced that it ends the run; the sentence gives its reason."""


_SAY_EVERY_S = 0.5


def say_every_s(timeout_s: float) -> float:
    """Time in which everybody hears something of a run, where each waits `timeout_s` for that."""
    return min(_SAY_EVERY_S, timeout_s / 4)


def new_run_id() -> int:
    """Return a random number that is not zero."""
    return secrets.randbits(63) | 1


class Publisher:
    """Numbers and counts what one role publishes, and announces the counts at the end."""

    def __init__(self, port: Port, run_id: int) -> None:
        self.port, self.run_id = port, run_id
        self.ended = False
        self.counters = {
            name: sequence_checker.Counter()
            for name, stream in streams.STREAMS.items()
            if stream.publisher == port.role and not name.startswith("end/")
        }

    def send(
        self, stream: str, header: Message, arrays: Mapping[str, np.ndarray] | None = None
    ) -> None:
        """Publish one message, completing run id and sequence number.

        Raises StreamFault for a number that is not finite; nothing is sent then.
        """
        counter = self.counters[stream]
        fields = header.DESCRIPTOR.fields_by_name
        if "run_id" in fields:
            header.run_id = self.run_id  # type: ignore[attr-defined]
        if "sequence" in fields:
            header.sequence = counter.messages  # type: ignore[attr-defined]
        sequence_checker.refuse_not_finite(stream, counter.messages, header, arrays or {})
        payload = codec.encode(header, **(arrays or {}))
        self.port.publish(streams.Envelope(stream, payload, counter.messages))
        counter.messages += 1
        counter.samples += max((len(a) for a in (arrays or {}).values()), default=1)

    def end(self, fault: str = "", report: ControllerReport | None = None) -> None:
        """Announce what was published; the last message of a role, once."""
        if self.ended:
            return
        self.ended = True
        counts = [
            StreamCount(stream=name, messages=c.messages, samples=c.samples)
            for name, c in self.counters.items()
        ]
        header = RunEnd(
            run_id=self.run_id, role=self.port.role, count=counts, fault=fault, report=report
        )
        self.port.publish(streams.Envelope(f"end/{self.port.role}", header.SerializeToString(), 0))


Handler = Callable[[streams.Envelope], None]


class InProcessBus:
    """Delivers every message to the roles that hear its stream before `publish` returns.

    A message published while another is being delivered waits its turn, so all
    subscribers see all streams in one order.
    """

    def __init__(self) -> None:
        self._handlers: list[tuple[str, Handler]] = []
        self._waiting: deque[streams.Envelope] = deque()
        self._delivering = False

    def attach(self, role: str, handler: Handler) -> None:
        """Let `handler` see every message of the streams that `role` hears."""
        self._handlers.append((role, handler))

    def deliver(self, envelope: streams.Envelope) -> None:
        """Hand a message to all who hear it."""
        self._waiting.append(envelope)
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                item = self._waiting.popleft()
                for role, handler in self._handlers:
                    if item.stream in streams.SUBSCRIPTIONS[role]:
                        handler(item)
        finally:
            self._delivering = False


class InProcessPort:
    """Port of one role on an InProcessBus; collects what came until it is received."""

    def __init__(self, bus: InProcessBus, role: str, handler: Handler | None = None) -> None:
        self.role = role
        self._bus = bus
        self._inbox: deque[streams.Envelope] = deque()
        bus.attach(role, handler or self._inbox.append)

    def publish(self, envelope: streams.Envelope) -> None:
        """Send to all roles that hear the stream."""
        self._bus.deliver(envelope)

    def receive(
        self, timeout_s: float, awaited: str, senders: Collection[str] = ()
    ) -> streams.Envelope:
        """Next message. In one thread nobody else can still send one: an empty inbox raises."""
        if not self._inbox:
            raise PeerLost(f"{self.role} waits for {awaited}, but nothing was sent")
        return self._inbox.popleft()

    def pending(self) -> bool:
        """Whether a message is there."""
        return bool(self._inbox)

    def close(self) -> None:
        """Nothing to do: the bus goes with the process."""
