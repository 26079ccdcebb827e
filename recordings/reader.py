"""Read a recording, whole or damaged: what is there, and in sentences what is not.

Samples are read again whenever somebody asks for them, so that a long recording needs no
more memory than what is looked at.

`Walk` reads past damage: it goes on at the next record that can be one. It believes no length, no
size to unpack to, and no content without its checksum. A program other than hertzloop may have left
checksums out, as MCAP allows: `Walk.unchecked` then says where. `Intake` keeps what belongs to the
run, and a `Track` joins the blocks of a stream and names those that do not follow.
"""

import heapq
import os
import re
import stat
import struct
import sys
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property, partial
from graphlib import CycleError, TopologicalSorter
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Footer, Header, Message, Metadata

from hertzloop.bus import codec, sequence_checker, streams
from hertzloop.bus.codec import DecodedBlock, MessageError
from hertzloop.bus.events import MODES
from hertzloop.bus.messages_pb2 import Books, EventKind, Hello, RunEnd
from hertzloop.bus.sequence_checker import not_finite
from hertzloop.recordings import writer
from hertzloop.whole_files import whole_file

MAGIC = b"\x89MCAP0\r\n"
RECORD_BYTES = 64 << 20  # at most, of a record, and of a chunk when unpacked
# A whole file may unpack to the larger of these: 20 million steps are 1.6 GB, and samples do
# not shrink to a thousandth.
TOTAL_BYTES, TOTAL_RATIO = 2 << 30, 1000
_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")  # times, size unpacked, checksum, length of the next name
_MESSAGE = struct.Struct("<HIQQ")
_WINDOW = 1 << 20
_LENGTHS = {Opcode.HEADER: 8, Opcode.METADATA: 8, Opcode.ATTACHMENT: 36, Opcode.CHUNK: 40}
_EXACT = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
# Bytes at the start, and sizes of the lengths with which the pieces begin that follow: kinds whose
# own length would be believed otherwise, for want of a checksum, or where zero stands for none.
_PIECES: dict[int, tuple[int, tuple[int, ...]]] = {
    Opcode.HEADER: (0, (4, 4)), Opcode.METADATA: (0, (4, 4)), Opcode.MESSAGE_INDEX: (2, (4,)),
    Opcode.SCHEMA: (2, (4, 4, 4)), Opcode.CHANNEL: (4, (4, 4, 4)),
    Opcode.ATTACHMENT: (16, (4, 4, 8)),
}  # fmt: skip
_CHECKSUM = {Opcode.ATTACHMENT: 4}  # bytes after the pieces
_CHECKED = (Opcode.CHUNK, Opcode.ATTACHMENT)  # kinds with a checksum of their own
_CHAIN = 4  # records that follow one another are no chance

SAMPLED = tuple(sorted(s.name for s in streams.STREAMS.values() if s.numbered))  # daq, force, truth


class Damaged(Exception):
    """Why something in a file cannot be believed."""


class McapRecord(NamedTuple):
    """A record of the file's outermost level: kind, first byte, length in the file, and its
    content: unpacked, and empty for kinds nobody reads."""

    opcode: int
    at: int
    length: int
    content: bytes


@dataclass
class Walk:
    """A walk over a file of `size` bytes; `damage` lists in sentences what was passed over.

    `late_channels` are those that the summary repeats, `not_so` where what seemed a record is
    none, `unchecked` where a record is whose checksum was left out.
    """

    handle: int
    size: int
    damage: list[str] = field(default_factory=list)
    late_channels: dict[int, str] = field(default_factory=dict)
    not_so: set[int] = field(default_factory=set)
    unchecked: set[int] = field(default_factory=set)
    checked: int = 0  # bytes, packed and unpacked

    def read(self, at: int, length: int) -> bytes:
        """Bytes of the file, fewer at its end."""
        return os.pread(self.handle, length, at)

    @cached_property
    def library(self) -> str:
        """What wrote the file, as its header says; empty where that cannot be read."""
        try:
            opcode, length = self.head(len(MAGIC))
            header = Header.read(ReadDataStream(BytesIO(self.read(len(MAGIC) + 9, length))))
        except Exception:  # whatever the library makes of bytes that mean nothing
            return ""
        return header.library if opcode == Opcode.HEADER else ""

    @property
    def is_ours(self) -> bool:
        """Whether hertzloop wrote the file, which leaves no checksum out, or nobody knows."""
        return self.library in ("", writer.LIBRARY)

    def left_out(self, at: int) -> None:
        """Note that the record at a byte has no checksum. Raises Damaged where it must have one."""
        if self.is_ours:
            raise Damaged("a checksum is missing")
        self.unchecked.add(at)

    def records(self) -> Iterator[McapRecord]:
        """All records that can be read; a chunk's content is checked and unpacked.

        After damage, what has a checksum and was passed over comes last: a length that is damaged,
        or not where it belongs, may have spanned it.
        """
        sure: list[tuple[int, int]] = []
        for record in self._one_after_another():
            if self._is_checked(record):
                sure.append((record.at, record.at + 9 + record.length))
            yield record
        if self.damage:
            end = 8
            for first, after in [*sure, (self.size, self.size)]:
                yield from self._passed(end, first)
                end = after

    def _one_after_another(self) -> Iterator[McapRecord]:
        at, whole = 8, True
        if self.read(0, 8) != MAGIC:
            self._passed_over(0, 8, "it does not begin as an MCAP file")
            at = at if self._follows(8) else self._resume(0)
        while 0 <= at < self.size:
            opcode = length = 0
            try:
                opcode, length = self.head(at)
                content = self.content(opcode, at, length)
            except Damaged as error:
                after = at + 9 + length
                found = after if length and self._follows(after) else self._resume(at + 1)
                self._passed_over(at, found if found >= 0 else self.size, str(error))
                self.not_so.add(at)
                at, whole = found, False
                continue
            if opcode == Opcode.DATA_END:
                self._check_data(at, content, whole)
                self.check_rest(at + 9 + length)
                return
            if whole or opcode != Opcode.MESSAGE:  # without a checksum, one must be in its place
                yield McapRecord(opcode, at, length, content)
            at += 9 + length
        if whole:
            self.damage.append("the file ends where more data were expected")

    def _passed(self, start: int, end: int) -> Iterator[McapRecord]:
        """Records with a checksum from `start` to `end`, whatever else was seen there."""
        reached = start
        for at in self._heads(start, end, _CHECKED):
            if at < reached or at in self.not_so:
                continue
            with suppress(Damaged):
                opcode, length = self.head(at)
                if at + 9 + length > end:
                    continue
                record = McapRecord(opcode, at, length, self.content(opcode, at, length))
                if self._is_checked(record):
                    yield record
                    reached = at + 9 + length

    def again(self, record: McapRecord) -> McapRecord:
        """A record once more, its content read anew. Raises Damaged if it no longer is one."""
        content = self.read(record.at + 9, record.length)
        if record.opcode == Opcode.CHUNK:
            content = unpacked(content)
        return record._replace(content=content)

    def _passed_over(self, first: int, end: int, why: str) -> None:
        self.damage.append(f"bytes {first} to {end - 1} of {self.size} are damaged: {why}")

    def head(self, at: int) -> tuple[int, int]:
        """Kind and length of the record at a byte. Raises Damaged if there can be none."""
        head = self.read(at, 9)
        if len(head) < 9:
            raise Damaged("a record is cut off")
        opcode, length = _HEAD.unpack(head)
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END:
            raise Damaged(f"no record begins with {opcode}")
        if length > self.size - at - 9:
            raise Damaged("a record is cut off, or its length is damaged")
        if length > RECORD_BYTES:
            raise Damaged(f"a record of {length} bytes is larger than any of a recording")
        if length < _LENGTHS.get(opcode, 0) or length != _EXACT.get(opcode, length):
            raise Damaged(f"a record of kind {opcode} has {length} bytes")
        return opcode, length

    def content(self, opcode: int, at: int, length: int) -> bytes:
        """Content of a record, as `McapRecord` has it. Raises Damaged if its checks fail."""
        if opcode == Opcode.CHUNK_INDEX:
            return b""
        if opcode in _CHECKED:
            self.count(length)
        content = self.read(at + 9, length)
        if len(content) < length:
            raise Damaged("a record is cut off")
        if opcode in _PIECES:  # each after its length, they have to fill the record
            end, sizes = _PIECES[opcode]
            for size in sizes:
                end += size + int.from_bytes(content[end : end + size], "little")
            if end + _CHECKSUM.get(Opcode(opcode), 0) != length:
                raise Damaged(f"the lengths in a record of kind {opcode} do not agree")
        if opcode in (Opcode.MESSAGE_INDEX, Opcode.HEADER):
            return b""
        if opcode == Opcode.ATTACHMENT:
            [checksum] = struct.unpack("<I", content[-4:])
            if not checksum:
                self.left_out(at)
            elif checksum != zlib.crc32(content[:-4]):
                raise Damaged("the checksum of an attachment does not fit")
        if opcode == Opcode.CHUNK:
            _, size, checksum, _ = _chunk_head(content, length)
            self.count(size)
            if not checksum:
                self.left_out(at)
            content = unpacked(content)
        return content

    def _is_checked(self, record: McapRecord) -> bool:
        return record.opcode in _CHECKED and record.at not in self.unchecked

    def count(self, size: int) -> None:
        """Count bytes that are to be checked, wherever something seems to begin; raises Damaged
        if they would be too many."""
        if self.checked + size > max(TOTAL_BYTES, TOTAL_RATIO * self.size):
            raise Damaged(f"what is packed in {self.size} bytes is more than a recording may hold")
        self.checked += size

    def _check_data(self, at: int, content: bytes, whole: bool) -> None:
        """Compare the checksum over all data; known damage needs no second sentence."""
        checksum = 0
        for first in range(0, at, _WINDOW):
            checksum = zlib.crc32(self.read(first, min(_WINDOW, at - first)), checksum)
        [told] = struct.unpack("<I", content)
        if not (told or self.is_ours):
            self.unchecked.add(at)
        elif whole and told != checksum:
            self.damage.append("the checksum over all data does not fit, or is missing")
        elif whole:
            self.unchecked.clear()  # it covers them

    def check_rest(self, start: int) -> None:
        """Check that what follows the data is summary, footer, magic, and nothing else."""
        end = self.size - 37
        rest = self.read(start, min(self.size - start, RECORD_BYTES))
        found = rest.find(_HEAD.pack(Opcode.FOOTER, 20), max(end - start, 0))
        try:
            for opcode, content in inner_records(rest[: max(end - start, 0)]):
                if opcode == Opcode.CHANNEL:
                    channel = _parsed(Channel, content, "a channel")
                    self.late_channels[channel.id] = channel.topic
        except Damaged:
            self.late_channels.clear()
        if end < start or start + found != end or rest[-8:] != MAGIC:
            self._passed_over(start, self.size, "the footer is not the end of the file")
            return
        footer = Footer.read(ReadDataStream(BytesIO(rest[end - start + 9 :])))
        told = footer.summary_crc
        if told != zlib.crc32(rest[:-12]) and (told or self.is_ours):
            self._passed_over(start, self.size, "the checksum of the summary does not fit")

    def _follows(self, at: int) -> bool:
        """Whether records follow one another from here on, or the file ends here."""
        for _ in range(_CHAIN):
            if at == self.size - 8:
                return self.read(at, 8) == MAGIC
            try:
                _, length = self.head(at)
            except Damaged:
                return False
            at += 9 + length
        return True

    def _resume(self, start: int) -> int:
        """First byte from `start` on at which a record begins; -1 if there is none."""
        heads = self._heads(start, self.size, range(Opcode.HEADER, Opcode.DATA_END + 1))
        return next((place for place in heads if self._follows(place)), -1)

    def _heads(self, start: int, end: int, kinds: Sequence[int]) -> Iterator[int]:
        """Bytes from `start` to `end` at which a record of these kinds may begin."""
        for first in range(start, end, _WINDOW):
            window = np.frombuffer(self.read(first, min(_WINDOW, end - first) + 8), np.uint8)
            count = len(window) - 8
            if count <= 0:
                break
            may = np.isin(window[:count], np.array(kinds, np.uint8))
            for shift in (5, 6, 7, 8):  # no length reaches 4 GiB
                may &= window[shift : shift + count] == 0
            yield from (first + place for place in np.flatnonzero(may).tolist())


def _chunk_head(content: bytes, length: int) -> tuple[str, int, int, int]:
    """Compression, size unpacked, checksum and place of the data; raises Damaged unless the
    lengths agree."""
    if len(content) < _CHUNK.size + 8:
        raise Damaged("a chunk is too short")
    _, _, size, checksum, name_length = _CHUNK.unpack_from(content)
    at = _CHUNK.size + name_length
    if name_length > 8 or len(content) < at + 8:
        raise Damaged("a chunk's compression has no name")
    name = content[_CHUNK.size : at].decode(errors="replace")
    [packed] = struct.unpack_from("<Q", content, at)
    if name not in ("", "zstd", "lz4") or at + 8 + packed != length:
        raise Damaged("the lengths in a chunk do not agree")
    if size > RECORD_BYTES:
        raise Damaged(f"a chunk of {length} bytes would unpack to {size}, {RECORD_BYTES} at most")
    return name, size, checksum, at + 8


def unpacked(content: bytes) -> bytes:
    """The records in a chunk. Raises Damaged if they are too many or not what was written, as far
    as a checksum tells."""
    name, size, checksum, at = _chunk_head(content, len(content))
    packed = content[at:]
    try:
        if name == "zstd":
            reader = zstandard.ZstdDecompressor(max_window_size=RECORD_BYTES)
            with reader.stream_reader(packed) as stream:
                data = stream.read(size + 1)
        elif name == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, size + 1)
        else:
            data = packed
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise Damaged(f"a chunk cannot be unpacked ({error})") from error
    if len(data) != size:
        raise Damaged(f"a chunk does not unpack to the {size} bytes it announces")
    if checksum and checksum != zlib.crc32(data):
        raise Damaged("the checksum of a chunk does not fit")
    return data


def inner_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Kind and content of records that follow one another. Raises Damaged."""
    at = 0
    while at < len(data):
        if at + 9 > len(data):
            raise Damaged("a record in a chunk is cut off")
        opcode, length = _HEAD.unpack_from(data, at)
        at += 9
        if length > len(data) - at:
            raise Damaged("a record in a chunk is longer than the chunk")
        yield opcode, data[at : at + length]
        at += length


def message_of(content: bytes) -> Message:
    """A message from its record. Raises Damaged."""
    if len(content) < _MESSAGE.size:
        raise Damaged("a message is too short")
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    return Message(channel, log_time, content[_MESSAGE.size :], publish_time, sequence)


Arrays = dict[str, np.ndarray]
IN_MEMORY = 1 << 20  # samples: rows of truth have 84 MB then
PIECE = 1 << 16


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

    def __contains__(self, name: object) -> bool:
        return name in self.dtypes  # reads no column

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

    def step_at(self, positions: np.ndarray | int) -> np.ndarray:
        """Step of the samples at these positions."""
        steps = self.first_step + self.every_steps * np.asarray(positions, dtype=np.int64)
        for position, step in self.resumed:
            later = step + self.every_steps * (np.asarray(positions, dtype=np.int64) - position)
            steps = np.where(np.asarray(positions) >= position, later, steps)
        return np.asarray(steps)

    def time_ns_at(self, position: int) -> int:
        """Simulated time of the sample at a position, ns."""
        return int(self.step_at(position)) * self.step_ns

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

    def placed(self) -> Iterator[tuple[int, Arrays]]:
        """The same as `blocks`, each with the position of its first sample."""
        at = 0
        for arrays in self.blocks():
            yield at, arrays
            at += len(next(iter(arrays.values())))

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
        if (header.first_step + count * every) * header.step_ns > streams.LAST_NS:
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
                raise writer.RecordingError(
                    f"stream '{self.name}' had {self.samples} samples and now has {count}: the "
                    "recording changed while it was read"
                )

        return blocks


MOST_EVENTS = 1_000_000  # a sphere at rest: 130 000 in 20 million steps
MOST_TEXT = 200_000_000  # characters of all events together
_MOST_PROBLEMS = 40
_NAMELESS = "events"  # of a publisher that is no role
_KINDS = {
    topic: next(s for s in streams.STREAMS.values() if s.topic == topic) for topic in writer.TOPICS
}


class Fact(NamedTuple):
    """What programs read of an event."""

    kind: EventKind = EventKind.SENTENCE
    number: int = 0
    quantity: str = ""
    mode_before: int = 0
    mode: int = 0


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
    announced_toml: str = ""  # the whole scene, where the hello leaves out some of it
    books: Books | None = None
    pacing: DecodedBlock | None = None
    ends: dict[str, RunEnd] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    counters: dict[str, sequence_checker.Counter] = field(default_factory=dict)
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
                self._attachment(_parsed(Attachment, record.content, "Attachment"))
            elif record.opcode == Opcode.METADATA:
                self._metadata(_parsed(Metadata, record.content, "Metadata"))
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
        if attachment.name == writer.LAW_ATTACHMENT:
            self.law_source = self.law_source or attachment.data.decode(errors="replace")
        if attachment.name != writer.SCENE_ATTACHMENT:
            return
        if self.scene_toml:
            self._problem("there is a second scene; the first is used")
            return
        try:
            self.scene_toml = attachment.data.decode()
        except UnicodeDecodeError as error:
            raise Damaged("the scene is not text") from error

    def _metadata(self, metadata: Metadata) -> None:
        if metadata.name == writer.RUN_METADATA:
            if self.metadata is None:
                self.metadata = dict(metadata.metadata)
                try:
                    self.run_id = int(self.metadata.get("run_id", "0"), 16)
                except ValueError:
                    self._problem("the run's id cannot be read")
            elif not any("a second scene" in problem for problem in self.problems):
                self._problem("there is a second description of the run; the first is used")
        elif metadata.name == writer.RESULT_METADATA:
            if self.result is not None:
                self._problem("there is a second result of the run; the first is used")
            else:
                self.result = dict(metadata.metadata)

    def _inner(self, opcode: int, content: bytes) -> Iterator[Taken]:
        if opcode == Opcode.CHANNEL:
            channel = _parsed(Channel, content, "a channel")
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
            block = codec.decoded(streams.Envelope(_KINDS[topic].name, message.data))
            header: Any = block.header
            if topic == "/events":
                # Whoever brings a controller may call it as he likes.
                name = f"events/{header.name}"
                name = name if name in streams.STREAMS else _NAMELESS
            elif topic == "/end":
                name = f"end/{header.role}"
            if name not in streams.STREAMS and name != _NAMELESS:
                raise Refused(f"'{name[:40]}' is not a stream of a run")
            if hasattr(header, "run_id"):
                self.run_id = self.run_id or header.run_id
                if header.run_id != self.run_id:
                    raise Refused(f"it belongs to run {header.run_id:x}, not to {self.run_id:x}")
            if name != _NAMELESS:  # note where in its stream the message belongs
                number = getattr(header, "sequence", message.sequence)
                self.first.setdefault(name, number)
                self.out_of_place |= number < self._highest.get(name, 0)
                self._highest[name] = max(number, self._highest.get(name, 0))
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
        counter = self.counters.setdefault(name, sequence_checker.Counter())
        counter.messages += 1
        counter.samples += codec.sample_count(block)
        yield Taken(name if name in streams.STREAMS else _KINDS[topic].name, message, arrays)

    def _single(self, name: str, header: Any, message: Message) -> str:
        """Keep a message that is no block; a sentence on what is missing before it."""
        expected = self._next.get(name, 0)
        if name == _NAMELESS:
            self._event(header, message)
            return ""
        if message.sequence < expected:
            raise Refused(f"number {message.sequence} is repeated")
        if streams.STREAMS[name].once and self.counters.get(name):
            raise Refused("there is a second one; the first is used")
        self._next[name] = message.sequence + 1
        if name == "hello":
            self.hello = header
        elif name == "scene":
            self.announced_toml = header.scene_toml
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
        if told != message.log_time or told > streams.LAST_NS:
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
        for role in (streams.PLANT, streams.CONTROLLER):
            end = self.ends.get(role)
            if end is None:
                self._problem(f"the {role} announced no end: counts cannot be reconciled")
                continue
            announced = {count.stream: count for count in end.count}
            for name, stream in streams.STREAMS.items():
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
        names = [name for name in streams.STREAMS if streams.STREAMS[name].topic == "/events"]
        here = sum(
            self.counters.get(n, sequence_checker.Counter()).messages for n in [*names, _NAMELESS]
        )
        announced = sum(
            count.messages for e in self.ends.values() for count in e.count if count.stream in names
        )
        if here != announced:
            self._problem(f"{here} events are here, {announced} were announced")

    def _reconcile(self, role: str, name: str, announced: Any) -> None:
        here = self.counters.get(name, sequence_checker.Counter())
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
        text = (self.metadata or {}).get("steps", "0")
        try:
            steps = int(text)
        except ValueError:
            steps = -1
        if not 0 <= steps <= streams.LAST_NS:
            self._problem(f"the length of the run cannot be read: '{text[:40]}'")
            return 0
        return steps

    def agree(self) -> None:
        """Fill what the hello says, too, and name where it says something else."""
        hello = self.hello
        if hello is None:
            return
        described, announced = writer.described_by(hello), self.announced_toml or hello.scene_toml
        if not self.scene_toml:
            self._problem("the scene is that of the hello: the file has no other")
            self.scene_toml = announced
        elif self.scene_toml != announced:
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


def _parsed(kind: Any, content: bytes, name: str) -> Any:
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # whatever the library makes of lengths that mean nothing
        raise Damaged(f"{name} cannot be read ({type(error).__name__})") from error


def in_order(numbers: Sequence[Mapping[str, int]]) -> list[int]:
    """Positions of parts so that the messages of every stream follow one another; else as they are.

    `numbers` has, for each part, the first number of every stream in it. Where no order suits all
    streams, as only a forged file has it, the parts stay as they are.
    """
    by_stream: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for position, first in enumerate(numbers):
        for stream, number in first.items():
            by_stream[stream].append((number, position))
    graph = TopologicalSorter[int]({position: () for position in range(len(numbers))})
    for of_stream in by_stream.values():
        for (_, position), (_, follows) in pairwise(sorted(of_stream)):
            graph.add(follows, position)
    try:
        graph.prepare()
    except CycleError:
        return list(range(len(numbers)))
    order: list[int] = []
    ready: list[int] = []
    while graph.is_active():
        for position in graph.get_ready():
            heapq.heappush(ready, position)
        order.append(heapq.heappop(ready))
        graph.done(order[-1])
    return order


_OF_PLANT = (
    (EventKind.CONTACT_BEGAN, re.compile(r"contact (?P<number>[0-9]{1,18}) began")),
    (EventKind.CONTACT_ENDED, re.compile(r"contact (?P<number>[0-9]{1,18}) ended")),
    (EventKind.RANGE_LEFT, re.compile(r"(?P<quantity>\w+) left the converter's range")),
    (EventKind.RANGE_REGAINED, re.compile(r"(?P<quantity>\w+) is back in the converter's range")),
)
_LAW = re.compile(r"law (mode )?(\w+) -> (mode )?(\w+)(, .*)?")


def fact_of(event: Any) -> Fact:
    """The typed part of a message `Event`."""
    quantity = sys.intern(event.quantity)
    return Fact(event.kind, event.number, quantity, event.mode_before, event.mode)


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


_DAMAGES_NAMED = 5


@dataclass
class Recording:
    """What a file holds. `problems` lists gaps and damage in sentences; empty when whole.

    `others`: how many messages are of topics that are none of ours, and were passed over.
    `unchecked`: how many parts of the file no checksum covers, since another program wrote it.
    `law_source`: text of the law that the plant announced.
    """

    path: Path
    scene_toml: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
    result: dict[str, str] = field(default_factory=dict)
    daq: JoinedStream = field(default_factory=JoinedStream)
    force: JoinedStream = field(default_factory=JoinedStream)
    truth: JoinedStream = field(default_factory=JoinedStream)
    events: list[Event] = field(default_factory=list)
    books: Books | None = None
    pacing: DecodedBlock | None = None  # a Pacing, of a paced run
    ends: dict[str, RunEnd] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    law_source: str = ""
    others: int = 0
    unchecked: int = 0

    @property
    def other_version(self) -> str:
        """By which version it was recorded and which this is, in brackets; empty for this one."""
        return sequence_checker.other_version(
            self.metadata.get("versions", ""), "it was recorded by"
        )

    @property
    def daq_values(self) -> np.ndarray:
        """Acquired values in the unit of the quantity, shape (samples,)."""
        return self.daq.values_of(self.daq.arrays)


class Place(NamedTuple):
    """Where a record is, the topics of its messages, and the first number of every stream."""

    record: McapRecord
    topics: frozenset[str]
    first: dict[str, int]


class Source:
    """The file of a recording, open as long as somebody reads from it.

    Raises RecordingError, here and wherever it is read, if it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reading():
            # Without waiting for a writer, should it be a pipe.
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        status = os.fstat(self._handle)
        if not stat.S_ISREG(status.st_mode):
            kind = "Is a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise writer.UnreadableRecording(f"cannot read {path}: {kind}")
        self.size = status.st_size
        self._places: list[Place] = []
        self._channels: dict[int, str] = {}

    def __del__(self) -> None:
        if hasattr(self, "_handle"):
            os.close(self._handle)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            absent = isinstance(error, FileNotFoundError)
            remedy = ". Give the path of a recording." if absent else ""
            raise writer.UnreadableRecording(
                f"cannot read {self.path}: {error.strerror}{remedy}"
            ) from error

    def messages(self, intake: Intake, records: Iterable[McapRecord]) -> Iterator[Taken]:
        """All messages in `records` that belong to the run; `intake` knows then what else is
        there."""
        self._places.clear()
        with self._reading():
            for record in records:
                topics: set[str] = set()
                for taken in intake.take(record):
                    topics.add(streams.STREAMS[taken.stream].topic)
                    yield taken
                if record.content:
                    place = Place(record._replace(content=b""), frozenset(topics), intake.first)
                    self._places.append(place)
        self._channels = intake.channels

    def walk(self) -> Walk:
        """A new walk over the file."""
        return Walk(self._handle, self.size)

    def look(self, keep: bool = False) -> tuple[Intake, Walk]:
        """Everything but the samples, or with those of the streams that are short enough to
        `keep`. A file whose parts are where they belong is read once."""
        walk = self.walk()
        intake = self._drained(Intake(keep=keep), walk.records())
        if intake.unknown_channels:
            # The record that names them is lost, or comes later. The summary repeats it; without
            # one, our writer's order is the best guess, and what a message is shows when it is
            # decoded.
            guessed = walk.late_channels or dict(enumerate(writer.TOPICS, 1))
            named = intake.unknown_channels <= set(intake.channels)
            again = Intake(guessed | intake.channels, unnamed_channels=not named, keep=keep)
            intake = self._drained(again, self.records())
        if intake.out_of_place:
            self._places = [self._places[n] for n in in_order([p.first for p in self._places])]
            again = Intake(intake.channels, unnamed_channels=intake.unnamed_channels, keep=keep)
            intake = self._drained(again, self.records())
            intake.problems.append("parts of the file have changed places, or are there twice")
        return intake, walk

    def _drained(self, intake: Intake, records: Iterable[McapRecord]) -> Intake:
        for _ in self.messages(intake, records):
            pass
        return intake

    def names_a_scene(self) -> bool:
        """Whether there is a scene, or a hello, which has one."""
        intake = Intake()
        for _ in self.messages(intake, self.walk().records()):
            if intake.scene_toml or intake.hello:
                return True
        return bool(intake.scene_toml)

    def records(self) -> Iterator[McapRecord]:
        """The records once more, after `look`, in the order in which they belong."""
        walk, places = self.walk(), list(self._places)
        return (self._read(walk, place) for place in places)

    def _read(self, walk: Walk, place: Place) -> McapRecord:
        try:
            return walk.again(place.record)
        except Damaged as error:
            raise writer.RecordingError(
                f"{self.path} changed while it was read ({error})"
            ) from error

    def again(self, stream: str, run_id: int) -> Iterator[Arrays]:
        """The blocks of a stream once more, after `look`."""
        topic, walk = streams.STREAMS[stream].topic, self.walk()
        intake = Intake(channels=dict(self._channels), only=topic, run_id=run_id)
        with self._reading():
            for place in self._places:
                if topic in place.topics:
                    for taken in intake.take(self._read(walk, place)):
                        yield taken.arrays


def read(path: Path, keep: bool = False) -> Recording:
    """Read a recording as far as it is readable; with `keep`, samples of a short run stay in
    memory, for who looks at all of them.

    Raises RecordingError if there is no file, or no recording of hertzloop in it.
    """
    return _looked_at(path, keep)[0]


def _looked_at(path: Path, keep: bool = False) -> tuple[Recording, Source, Intake]:
    source = Source(path)
    if source.walk().library == writer.EXPORT_LIBRARY:
        raise writer.UnreadableRecording(
            f"{path} is an export of a recording, with one message a sample. Give the recording"
        )
    intake, walk = source.look(keep)
    intake.agree()
    if not intake.scene_toml:
        if walk.read(0, 8) != MAGIC and not intake.counters:
            raise writer.UnreadableRecording(
                f"{path}: is not an MCAP recording of hertzloop. Its exports cannot be read back"
            )
        why = f" ({walk.damage[0]})" if walk.damage else ""
        raise writer.UnreadableRecording(
            f"{path} holds no scene{why}: not a recording of hertzloop"
        )
    damage = [f"the file is cut off or damaged ({words})" for words in walk.damage]
    if len(damage) > _DAMAGES_NAMED:
        damage[_DAMAGES_NAMED:] = [f"... and in {len(damage) - _DAMAGES_NAMED} more places"]
    recording = Recording(
        path, intake.scene_toml, intake.metadata or {}, intake.result or {},
        events=intake.events, books=intake.books, pacing=intake.pacing, ends=intake.ends,
        law_source=intake.law_source, others=intake.others, unchecked=len(walk.unchecked),
    )  # fmt: skip
    for name in SAMPLED:  # a new row of STREAMS is an attribute more
        again: Callable[[], Iterator[Arrays]] = partial(source.again, name, intake.run_id)
        setattr(recording, name, intake.tracks[name].join(again))
    intake.reconcile()
    recording.problems = [*intake.problems, *damage]
    faults = [recording.result.get("fault", ""), *(end.fault for end in intake.ends.values())]
    if intake.result is None:
        recording.problems.append("the recorder did not finish the file")
    elif fault := next(filter(None, faults), ""):
        recording.problems.append(f"the run failed: {fault}")
    return recording, source, intake


def holds_a_run(path: Path) -> bool:
    """Whether a file can be read as a recording, if only its scene."""
    try:
        return Source(path).names_a_scene()
    except writer.RecordingError:
        return False


class Recovered(NamedTuple):
    """How many messages were copied, how many of topics that are none of ours were not, and how
    many parts of the old file no checksum covers."""

    messages: int
    others: int
    unchecked: int


def recover(path: Path, whole: Path, overwrite: bool = False) -> Recovered:
    """Copy every readable message of `path` that belongs to its run into a new file, with index
    and checksums.

    The new file says that it is incomplete and why. Raises RecordingError if there is nothing to
    recover or the new file exists or is in use, and NotWritten.
    """
    try:
        old, source, seen = _looked_at(path)
    except writer.RecordingError as error:
        raise writer.UnreadableRecording(f"nothing to recover: {error}") from error
    if whole.exists() and whole.samefile(path):
        raise writer.UnreadableRecording(
            f"{path} cannot be recovered into itself. Choose another name."
        )
    fault = old.result.get("fault", "")
    if old.problems and not fault:
        fault = f"recovered from {path.name}, which is cut off or damaged ({old.problems[0]})"
    if not seen.counters:
        raise writer.UnreadableRecording(f"{path} holds no message of a run: nothing to recover")
    copied = 0
    again = Intake(channels=dict(seen.channels))
    with whole_file(whole) as unfinished, ExitStack() as locked:
        if unfinished != whole:
            locked.callback(writer.RecordingWriter(whole, overwrite).finish, {})
        try:
            new = writer.RecordingWriter(unfinished, overwrite)
            new.scene(old.scene_toml, old.metadata)
            for taken in source.messages(again, source.records()):
                message = taken.message
                new.write(taken.stream, message.data, message.sequence, message.log_time)
                copied += 1
            new.finish({"complete": "no" if fault else "yes", "fault": fault})
        except writer.NotRecorded as error:
            raise error.reason from error  # `whole_file` names the file
    return Recovered(copied, old.others, old.unchecked)
