"""The one table of streams: who sends them, who hears them, and which message they carry."""

from dataclasses import dataclass

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from hertzloop.bus import messages_pb2 as messages

PLANT, CONTROLLER, RECORDER = ROLES = "plant", "controller", "recorder"
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

    @property
    def numbered(self) -> bool:
        """Whether its messages carry their own sequence number."""
        return "sequence" in self.message.DESCRIPTOR.fields_by_name


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
        Stream("balance", PLANT, messages.EnergyBalance, "/balance", once=True),
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
