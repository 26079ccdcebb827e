"""A recording in memory: what its file says of the run, its streams and its events."""

import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hertzloop.bus import sequence_checker, streams
from hertzloop.bus.codec import DecodedBlock
from hertzloop.bus.messages_pb2 import EnergyBalance, EventKind, RunEnd

SAMPLED = tuple(sorted(s.name for s in streams.STREAMS.values() if s.numbered))  # daq, force, truth


@dataclass
class SampledStream:
    """The samples of one stream, from step 0 on without a gap.

    Attributes:
        messages: Number of blocks.
        step_ns: Length of a step, ns.
        every_steps: Steps from one sample to the next.
        scale: Unit of the quantity per code of the converter.
        offset: Quantity at code 0.
        arrays: Arrays by field name, each of shape (samples,).
    """

    messages: int = 0
    step_ns: int = 0
    every_steps: int = 1
    scale: float = 1.0
    offset: float = 0.0
    arrays: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return max(map(len, self.arrays.values()), default=0)

    @property
    def end_step(self) -> int:
        """Step at which the next sample would follow."""
        return self.samples * self.every_steps

    @property
    def time_ns(self) -> np.ndarray:
        """Simulated time of every sample, shape (samples,), ns."""
        return np.arange(self.samples) * (self.every_steps * self.step_ns)

    @property
    def values(self) -> np.ndarray:
        """Acquired values in the unit of the quantity, shape (samples,).

        They come from the codes of a converter if there are any; empty without values.
        """
        codes = self.arrays.get("code")
        if codes is not None:
            return np.asarray(self.offset + self.scale * codes)
        return self.arrays.get("value", np.empty(0))

    def matrix(self, fields: Sequence[str]) -> np.ndarray:
        """Return arrays as the rows of one matrix, shape (fields, samples).

        Rows that were not recorded are zero. The arrays become rows of the matrix, so that a long
        run is in memory once.
        """
        first = self.arrays[fields[0]].base
        if not (isinstance(first, np.ndarray) and first.shape == (len(fields), self.samples)):
            first = np.zeros((len(fields), self.samples))
            for row, name in zip(first, fields, strict=True):
                if name in self.arrays:
                    row[:] = self.arrays[name]
                    self.arrays[name] = row
        return first


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
    daq: SampledStream = field(default_factory=SampledStream)
    force: SampledStream = field(default_factory=SampledStream)
    truth: SampledStream = field(default_factory=SampledStream)
    events: list[Event] = field(default_factory=list)
    balance: EnergyBalance | None = None
    pacing: DecodedBlock | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    law_source: str = ""
    others: int = 0
    unchecked: int = 0

    def __post_init__(self) -> None:
        """Give a sampled stream that has no field, one of your own, an attribute by its name."""
        for name in SAMPLED:
            self.__dict__.setdefault(name, SampledStream())

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

    def scene_value(self, table: str, key: str, default: Any = None) -> Any:
        """Return a value of the recorded scene, `default` if the scene has none or is not
        readable."""
        try:
            return tomllib.loads(self.scene_toml).get(table, {}).get(key, default)
        except tomllib.TOMLDecodeError:
            return default
