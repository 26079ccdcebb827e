"""Streams of a recording: what joins is taken block by block, what does not is named.

Samples stay in the file until somebody asks for them: in blocks, or a column at a time.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from mcap.records import Message

from hertzloop.bus.streams import LAST_NS, STREAMS, has_header_sequence
from hertzloop.bus.wire import DecodedBlock
from hertzloop.recordings.writer import RecordingError

Arrays = dict[str, np.ndarray]
IN_MEMORY = 1 << 20  # samples: rows of truth have 84 MB then
PIECE = 1 << 16
SAMPLED = tuple(sorted(filter(has_header_sequence, STREAMS)))  # daq, force, truth


class Columns(Mapping[str, np.ndarray]):
    """Arrays by field name, each read when it is asked for and kept while somebody uses it.

    `again` reads the blocks once more. Getting an item raises RecordingError if the file is no
    longer what it was.
    """

    def __init__(
        self, again: Callable[[], Iterator[Arrays]], dtypes: dict[str, np.dtype], samples: int
    ) -> None:
        self.again, self.samples = again, samples
        self.dtypes = dtypes
        self._used: WeakValueDictionary[str, np.ndarray] = WeakValueDictionary()

    def __getitem__(self, name: str) -> np.ndarray:
        found = self._used.get(name)
        if found is None:
            found = np.empty(self.samples, self.dtypes[name])
            at = 0
            for arrays in self.again():
                found[at : at + len(arrays[name])] = arrays[name]
                at += len(arrays[name])
            self._used[name] = found
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self.dtypes)

    def __len__(self) -> int:
        return len(self.dtypes)


@dataclass
class JoinedStream:
    """One stream joined over its blocks: arrays by field name, all of one length.

    `first_step`, `step_ns` and `every_steps` give the time of each sample; after a hole it goes
    on at the (position, step) that `resumed` lists.
    """

    messages: int = 0
    first_step: int = 0
    step_ns: int = 0
    every_steps: int = 1
    scale: float = 1.0
    offset: float = 0.0
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    resumed: list[tuple[int, int]] = field(default_factory=list)

    @property
    def samples(self) -> int:
        """Number of samples."""
        if isinstance(self.arrays, Columns):
            return self.arrays.samples
        return max((len(a) for a in self.arrays.values()), default=0)

    @property
    def end_step(self) -> int:
        """Step after that of the last sample."""
        return int(self.step_at(self.samples)) if self.samples else 0

    def step_at(self, positions: np.ndarray | int) -> np.ndarray:
        """Step of the samples at these positions."""
        steps = self.first_step + self.every_steps * np.asarray(positions, dtype=np.int64)
        for position, step in self.resumed:
            later = step + self.every_steps * (np.asarray(positions, dtype=np.int64) - position)
            steps = np.where(np.asarray(positions) >= position, later, steps)
        return np.asarray(steps)

    @property
    def time_ns(self) -> np.ndarray:
        """Simulated time of every sample, shape (samples,), ns."""
        times = np.arange(self.samples, dtype=np.int64)
        times *= self.every_steps
        times += self.first_step
        for position, step in self.resumed:
            times[position:] += step - times[position]
        times *= self.step_ns
        return times

    def values_of(self, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
        """Acquired values in the unit of the quantity, from a converter's codes where it has them;
        empty where there are none."""
        codes = arrays.get("code")
        if codes is not None and len(codes):
            return np.asarray(self.offset + self.scale * codes)
        return arrays.get("value", np.empty(0))

    def before_a_hole(self) -> "JoinedStream":
        """The samples up to the first one that is missing."""
        if not self.resumed:
            return self
        end = self.resumed[0][0]

        def again() -> Iterator[Arrays]:
            left = end
            for arrays in self.blocks():
                if left <= 0:
                    return
                yield {name: values[:left] for name, values in arrays.items()}
                left -= len(next(iter(arrays.values())))

        dtypes = getattr(self.arrays, "dtypes", {})
        return replace(self, arrays=Columns(again, dtypes, end), resumed=[])

    def blocks(self) -> Iterator[Arrays]:
        """The same arrays piece by piece, whatever the pieces; raises RecordingError if the file
        is no longer what it was."""
        if isinstance(self.arrays, Columns):
            yield from self.arrays.again()
        elif self.arrays:
            yield dict(self.arrays)

    def in_memory(self, most: int = IN_MEMORY) -> "JoinedStream":
        """The same with its arrays in memory, read once, for who looks at it several times; itself
        if it has more samples than `most`. Raises RecordingError as `blocks` does."""
        if not isinstance(self.arrays, Columns) or not 0 < self.samples <= most:
            return self
        held = {n: np.empty(self.samples, dtype) for n, dtype in self.arrays.dtypes.items()}
        at = 0
        for arrays in self.blocks():
            count = len(next(iter(arrays.values())))
            for name, values in held.items():
                values[at : at + count] = arrays[name]
            at += count
        return replace(self, arrays=held)

    def pieces(self) -> Iterator[tuple[int, Arrays]]:
        """The same in pieces of at least PIECE samples, but for the last, each with the position
        of its first one: what costs by the piece is worth it then. Raises as `blocks` does."""
        at, count, waiting = 0, 0, list[Arrays]()
        for arrays in self.blocks():
            waiting.append(arrays)
            count += len(next(iter(arrays.values())))
            if count >= PIECE:
                yield at, _joined(waiting)
                at, count, waiting = at + count, 0, []
        if waiting:
            yield at, _joined(waiting)


def _joined(blocks: list[Arrays]) -> Arrays:
    if len(blocks) == 1:
        return blocks[0]
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


class Refused(Exception):
    """Why a message cannot be part of the run."""


@dataclass
class Track:
    """Follows the blocks of one stream. `add` takes those that join."""

    name: str
    stream: JoinedStream = field(default_factory=JoinedStream)
    samples: int = 0
    next_step: int = 0
    next_sequence: int = 0
    dtypes: dict[str, np.dtype] = field(default_factory=dict)
    finite: bool = True
    kept: list[Arrays] | None = None  # all blocks, if they are to be kept and while they are few

    def add(self, block: DecodedBlock, message: Message) -> tuple[Arrays, str]:
        """Arrays of a block, and what is missing before it or wrong in it, "" if nothing.

        Raises Refused if it does not belong here.
        """
        header: Any = block.header
        every = getattr(header, "every_steps", 1)
        arrays = {name: values for name, values in block.arrays.items() if len(values)}
        flags = getattr(header, "saturated", b"")
        if flags:
            arrays["saturated"] = np.frombuffer(flags, np.uint8)
        count = max((len(values) for values in arrays.values()), default=0)
        self._check(header, message, every, arrays, count)
        expected = f"sequence {self.next_sequence} at step {self.next_step} was expected"
        found = f"sequence {header.sequence} at step {header.first_step} follows where {expected}"
        if header.sequence < self.next_sequence or header.first_step < self.next_step:
            raise Refused(found)
        stream, problem = self.stream, ""
        if stream.messages == 0:
            stream.step_ns, stream.every_steps = header.step_ns, every
            stream.scale = getattr(header, "scale", 1.0)
            stream.offset = getattr(header, "offset", 0.0)
        if header.sequence != self.next_sequence or header.first_step != self.next_step:
            problem = f"stream '{self.name}': {found}"
        if count and not self.dtypes:
            stream.first_step = header.first_step
            self.dtypes = {name: values.dtype for name, values in arrays.items()}
        elif count and header.first_step != self.next_step:
            stream.resumed.append((self.samples, header.first_step))
        stream.messages += 1
        self.samples += count
        self.next_sequence = header.sequence + 1
        self.next_step = header.first_step + count * every
        if self.kept is not None and count:
            self.kept.append(arrays)
            if self.samples > IN_MEMORY:
                self.kept = None
        return arrays, problem or self._not_finite(arrays, header.first_step, every)

    def _check(self, header: Any, message: Message, every: int, arrays: Arrays, count: int) -> None:
        """Raises Refused for a block that contradicts itself, its message or those before."""
        stream = self.stream
        if not header.step_ns or not every:
            raise Refused(f"its steps have {header.step_ns} ns, a sample comes every {every} steps")
        if (header.first_step + count * every) * header.step_ns > LAST_NS:
            raise Refused(f"it begins at step {header.first_step}, beyond any run")
        if message.log_time != header.first_step * header.step_ns:
            raise Refused(f"step {header.first_step} is recorded at {message.log_time} ns")
        if message.sequence != header.sequence & 0xFFFFFFFF:
            raise Refused(f"sequence {header.sequence} is recorded as {message.sequence}")
        if count and len({len(values) for values in arrays.values()}) > 1:
            lengths = {name: len(values) for name, values in arrays.items()}
            raise Refused(f"its arrays have the lengths {lengths}")
        if count and self.dtypes and set(arrays) != set(self.dtypes):
            raise Refused(f"its fields are {sorted(arrays)}, those before {sorted(self.dtypes)}")
        described = {"step_ns": header.step_ns, "every_steps": every}
        if hasattr(header, "scale"):
            described |= {"scale": header.scale, "offset": header.offset}
        for label, value in described.items():
            before = getattr(stream, label)
            # As words: what is not a number equals itself here.
            if stream.messages and repr(value) != repr(before):
                raise Refused(f"its {label} is {value}, that of those before {before}")

    def _not_finite(self, arrays: Arrays, first_step: int, every: int) -> str:
        """A sentence on the first value of the stream that is not finite, "" without one."""
        if not self.finite:
            return ""
        for name, values in arrays.items():
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                self.finite = False
                step = first_step + every * int(np.flatnonzero(~np.isfinite(values))[0])
                return f"stream '{self.name}': {name} is not finite at step {step}"
        return ""

    def join(self, again: Callable[[], Iterator[Arrays]]) -> JoinedStream:
        """The stream, its arrays still in the file unless they were kept."""
        if (kept := self.kept) is not None:
            self.stream.arrays = Columns(lambda: iter(kept), self.dtypes, self.samples)
            return self.stream
        self.stream.arrays = Columns(self._same(again), self.dtypes, self.samples)
        return self.stream

    def _same(self, again: Callable[[], Iterator[Arrays]]) -> Callable[[], Iterator[Arrays]]:
        """`again` with a check that there are as many samples as before."""

        def blocks() -> Iterator[Arrays]:
            count = 0
            for arrays in again():
                if arrays:
                    count += len(next(iter(arrays.values())))
                    yield arrays
            if count != self.samples:
                raise RecordingError(
                    f"stream '{self.name}' had {self.samples} samples and now has {count}: the "
                    "recording changed while it was read"
                )

        return blocks
