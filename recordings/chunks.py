"""The records of an MCAP file, one after another.

`intact` reads a file with the mcap library and stops at the first thing that is not as it should
be. `Walk` reads past damage: it goes on at the next record that can be one. Neither believes a
length, a size to unpack to, or a content without its checksum. A program other than hertzloop may
have left checksums out, as MCAP allows: `Walk.unchecked` then says where.
"""

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from typing import IO, NamedTuple, cast

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Message
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from hertzloop.recordings.writer import LIBRARY

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
        return self.library in ("", LIBRARY)

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
        if opcode in _PIECES and not _adds_up(opcode, content):
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
        """Whether a record that could be read had a checksum."""
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
                    channel = channel_of(content)
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


@dataclass
class _File:
    """What the mcap library reads from; it refuses to read more at once than a record may hold."""

    handle: int
    at: int = 0

    def read(self, length: int) -> bytes:
        if length > RECORD_BYTES:
            raise Damaged(f"a length of {length} bytes is larger than any of a recording")
        found = os.pread(self.handle, length, self.at)
        if len(found) < length:
            raise Damaged("the file ends where more data were expected")
        self.at += length
        return found


def intact(walk: Walk) -> Iterator[McapRecord]:
    """The records of an intact file, not walked yet, by the reader of the mcap library.

    The library checks the checksums of chunks and of all data. Sizes, the lengths inside records,
    the checksums of attachments and of the summary are checked here, since it does not.

    Raises:
        Damaged: the file is not intact, or has something that the library reads without a limit
            (lz4). A `Walk` tells what.
    """
    file = _File(walk.handle)
    reader = StreamReader(
        cast(IO[bytes], file), emit_chunks=True, validate_crcs=True, record_size_limit=RECORD_BYTES
    )
    found = reader.records
    at = len(MAGIC)
    while True:
        try:
            record = next(found)
        except Damaged:
            raise
        except Exception as error:  # whatever the library makes of bytes that mean nothing
            raise Damaged(f"the mcap library cannot read it ({type(error).__name__})") from error
        opcode, length = walk.head(at)
        if at + 9 + length != file.at:
            raise Damaged("a record does not end where it says")
        if isinstance(record, DataEnd):
            walk.check_rest(file.at)
            if record.data_section_crc:
                walk.unchecked.clear()  # it covers them
            else:
                walk.left_out(at)
            if walk.damage:
                raise Damaged(walk.damage[0])
            return
        if isinstance(record, Chunk):
            if not record.uncompressed_crc:
                walk.left_out(at)
            walk.count(length + record.uncompressed_size)
            content = _chunk_data(record)
        else:
            content = walk.content(opcode, at, length)
        yield McapRecord(opcode, at, length, content)
        at = file.at


def _chunk_data(chunk: Chunk) -> bytes:
    """The records in a chunk, unpacked by the mcap library."""
    size = chunk.uncompressed_size
    if size > RECORD_BYTES or chunk.compression not in ("", "zstd"):
        raise Damaged("a chunk is too large, or is packed without a limit")
    try:
        # The library would make room for whatever size the packed data announce.
        if chunk.compression and zstandard.frame_content_size(chunk.data) not in (-1, size):
            raise Damaged("a chunk unpacks to another size than it announces")
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(length)
    except Damaged:
        raise
    except Exception as error:
        raise Damaged(f"a chunk cannot be unpacked ({type(error).__name__})") from error
    if length != size:
        raise Damaged(f"a chunk does not unpack to the {size} bytes it announces")
    return data


def _adds_up(opcode: int, content: bytes) -> bool:
    """Whether the pieces of a record, each after its length, fill it."""
    at, sizes = _PIECES[opcode]
    for size in sizes:
        at += size + int.from_bytes(content[at : at + size], "little")
    return at + _CHECKSUM.get(Opcode(opcode), 0) == len(content)


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


def channel_of(content: bytes) -> Channel:
    """A channel from its record. Raises Damaged."""
    try:
        return Channel.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # whatever the library makes of lengths that mean nothing
        raise Damaged(f"a channel cannot be read ({type(error).__name__})") from error


def message_of(content: bytes) -> Message:
    """A message from its record. Raises Damaged."""
    if len(content) < _MESSAGE.size:
        raise Damaged("a message is too short")
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    return Message(channel, log_time, content[_MESSAGE.size :], publish_time, sequence)
