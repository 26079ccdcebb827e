"""A recording in memory: what its file says of the run, its streams and its events."""

import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hertzloop.bus import sequence_checker, streams
from hertzloop.bus.codec import DecodedBlock
from hertzloop.bus.messages_pb2 import EnergyBalance, EventKind, RunEnd
from hertzloop.recordings.joined_stream import JoinedStream

SAMPLED = tuple(sorted(s.name for s in streams.STREAMS.values() if s.numbered))  # daq, force, truth


class EventData(NamedTuple):
    """The part of an event that programs read.

    Of an event of kind TEXT, only the sentence is known.
    """

    kind: EventKind = EventKind.TEXT
    number: int = 0
    quantity: str = ""
    mode_before: int = 0
    mode: int = 0


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run.

    Attributes:
        time_ns: Simulated time, ns.
        name: Publisher: "plant", "controller", or what a controller of the user calls itself.
        level: Level as in foxglove.Log.
        message: Sentence for people.
        data: Data for programs.
    """

    time_ns: int
    name: str
    level: int
    message: str
    data: EventData = field(default=EventData(), repr=False)


def event_data(event: Any) -> EventData:
    """Return the data in a message `Event`."""
    quantity = sys.intern(event.quantity)
    return EventData(event.kind, event.number, quantity, event.mode_before, event.mode)


@dataclass
class Recording:
    """What the file of a recording holds.

    Attributes:
        path: The file.
        scene_toml: The scene as simulated, with the contents of all files that it names.
        metadata: Description of the run, see `file_format.run_metadata`.
        result: Whether the run is complete, its fault, and by stream the numbers of messages and
            samples.
        daq: Samples of the data acquisition.
        force: Commanded forces.
        truth: State of the plant at every step.
        events: Events in the order of the file.
        balance: Energy and momentum balance at the end of the run.
        pacing: Response times of a paced run.
        ends: Final messages by role.
        problems: Sentences on gaps and damage; empty for a complete recording.
        law_source: Text of the law that the plant announced.
        others: Number of messages of other topics, which are ignored.
        unchecked: Number of parts of the file that no checksum covers: another program wrote it.
    """

    path: Path
    scene_toml: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
    result: dict[str, str] = field(default_factory=dict)
    daq: JoinedStream = field(default_factory=JoinedStream)
    force: JoinedStream = field(default_factory=JoinedStream)
    truth: JoinedStream = field(default_factory=JoinedStream)
    events: list[Event] = field(default_factory=list)
    balance: EnergyBalance | None = None
    pacing: DecodedBlock | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    law_source: str = ""
    others: int = 0
    unchecked: int = 0

    @property
    def other_version(self) -> str:
        """Version of hertzloop that recorded it and this version, in brackets; empty if they are
        one."""
        return sequence_checker.other_version(
            self.metadata.get("versions", ""), "it was recorded by"
        )

    @property
    def note(self) -> str:
        """Note of the user, as the file has it, which may be any text; empty without one."""
        return self.metadata.get("note", "")

    @property
    def daq_values(self) -> np.ndarray:
        """Acquired values in the unit of the quantity, shape (samples,)."""
        return self.daq.values_of(self.daq.arrays)

    def scene_value(self, table: str, key: str, default: Any = None) -> Any:
        """Return a value of the recorded scene, `default` if the scene has none or is not
        readable."""
        try:
            return tomllib.loads(self.scene_toml).get(table, {}).get(key, default)
        except tomllib.TOMLDecodeError:
            return default
