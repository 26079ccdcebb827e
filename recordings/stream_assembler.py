"""Assembler that joins the blocks of one recorded stream."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcap.records import Message

from hertzloop.bus.codec import DecodedBlock
from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.joined_stream import Arrays, Columns, JoinedStream
from hertzloop.recordings.writer import RecordingError

_IN_MEMORY = 1 << 20  # samples at most: 84 MB of the stream truth


class RejectedMessage(Exception):
    """Why a message cannot be part of the run."""


@dataclass
class StreamAssembler:
    """Joins the blocks of one stream, and names what is missing between them.

    Attributes:
        name: Name of the stream.
        stream: What is known of the stream so far; `join` adds its arrays.
        blocks: All blocks so far, if they are to stay in memory; None if not, or if they are too
            many.
        next_step: Step at which the next block should begin.
    """

    name: str
    blocks: list[Arrays] | None = None
    stream: JoinedStream = field(default_factory=JoinedStream)
    next_step: int = 0
    _samples: int = 0
    _next_sequence: int = 0
    _dtypes: dict[str, np.dtype] = field(default_factory=dict)
    _finite: bool = True

    def add(self, block: DecodedBlock, message: Message) -> tuple[Arrays, str]:
        """Add a block.

        Args:
            block: The decoded block.
            message: The message that holds it.

        Returns:
            Its arrays by field name, and a sentence on what is missing before it or wrong in it,
            "" for nothing.

        Raises:
            RejectedMessage: it contradicts itself, its message or earlier blocks, or comes twice.
        """
        header: Any = block.header
        every = getattr(header, "every_steps", 1)
        arrays = {name: values for name, values in block.arrays.items() if len(values)}
        flags = getattr(header, "saturated", b"")
        if flags:
            arrays["saturated"] = np.frombuffer(flags, np.uint8)
        count = max((len(values) for values in arrays.values()), default=0)
        self._check(header, message, every, arrays, count)
        expected = f"sequence {self._next_sequence} at step {self.next_step} was expected"
        found = f"sequence {header.sequence} at step {header.first_step} follows where {expected}"
        if header.sequence < self._next_sequence or header.first_step < self.next_step:
            raise RejectedMessage(found)
        stream, problem = self.stream, ""
        if stream.messages == 0:
            stream.step_ns, stream.every_steps = header.step_ns, every
            stream.scale = getattr(header, "scale", 1.0)
            stream.offset = getattr(header, "offset", 0.0)
        if header.sequence != self._next_sequence or header.first_step != self.next_step:
            problem = f"stream '{self.name}': {found}"
        if count and not self._dtypes:
            stream.first_step = header.first_step
            self._dtypes = {name: values.dtype for name, values in arrays.items()}
        elif count and header.first_step != self.next_step:
            stream.resumed.append((self._samples, header.first_step))
        stream.messages += 1
        self._samples += count
        self._next_sequence = header.sequence + 1
        self.next_step = header.first_step + count * every
        if self.blocks is not None and count:
            self.blocks.append(arrays)
            if self._samples > _IN_MEMORY:
                self.blocks = None
        return arrays, problem or self._not_finite(arrays, header.first_step, every)

    def _check(self, header: Any, message: Message, every: int, arrays: Arrays, count: int) -> None:
        """Raise RejectedMessage if a block contradicts itself, its message or earlier blocks."""
        stream = self.stream
        if not header.step_ns or not every:
            raise RejectedMessage(
                f"its steps have {header.step_ns} ns, a sample comes every {every} steps"
            )
        if (header.first_step + count * every) * header.step_ns > LAST_NS:
            raise RejectedMessage(f"it begins at step {header.first_step}, beyond any run")
        if message.log_time != header.first_step * header.step_ns:
            raise RejectedMessage(f"step {header.first_step} is recorded at {message.log_time} ns")
        if message.sequence != header.sequence & 0xFFFFFFFF:
            raise RejectedMessage(f"sequence {header.sequence} is recorded as {message.sequence}")
        if count and len({len(values) for values in arrays.values()}) > 1:
            lengths = {name: len(values) for name, values in arrays.items()}
            raise RejectedMessage(f"its arrays have the lengths {lengths}")
        if count and self._dtypes and set(arrays) != set(self._dtypes):
            raise RejectedMessage(
                f"its fields are {sorted(arrays)}, those before {sorted(self._dtypes)}"
            )
        described = {"step_ns": header.step_ns, "every_steps": every}
        if hasattr(header, "scale"):
            described |= {"scale": header.scale, "offset": header.offset}
        for label, value in described.items():
            before = getattr(stream, label)
            # As text: NaN equals itself there.
            if stream.messages and repr(value) != repr(before):
                raise RejectedMessage(f"its {label} is {value}, that of those before {before}")

    def _not_finite(self, arrays: Arrays, first_step: int, every: int) -> str:
        """Return a sentence on the first value of the stream that is not finite, "" without one."""
        if not self._finite:
            return ""
        for name, values in arrays.items():
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                self._finite = False
                step = first_step + every * int(np.flatnonzero(~np.isfinite(values))[0])
                return f"stream '{self.name}': {name} is not finite at step {step}"
        return ""

    def join(self, read_blocks: Callable[[], Iterator[Arrays]]) -> JoinedStream:
        """Return the stream; `read_blocks` reads its blocks once more, if not in memory."""
        if (blocks := self.blocks) is not None:
            self.stream.arrays = Columns(lambda: iter(blocks), self._dtypes, self._samples)
        else:
            checked = self._checked(read_blocks)
            self.stream.arrays = Columns(checked, self._dtypes, self._samples)
        return self.stream

    def _checked(
        self, read_blocks: Callable[[], Iterator[Arrays]]
    ) -> Callable[[], Iterator[Arrays]]:
        """Return `read_blocks` with a check that there are as many samples as before."""

        def blocks() -> Iterator[Arrays]:
            count = 0
            for arrays in read_blocks():
                if arrays:
                    count += len(next(iter(arrays.values())))
                    yield arrays
            if count != self._samples:
                raise RecordingError(
                    f"stream '{self.name}' had {self._samples} samples and now has {count}: the "
                    "recording changed while it was read"
                )

        return blocks
