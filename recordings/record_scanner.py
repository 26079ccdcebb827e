"""Scanner for the records of a recording, which goes on behind damaged bytes.

After damage it goes on at the next byte at which a record can begin. It believes no length, no size
of unpacked data, and no content without its checksum. MCAP lets other programs leave checksums out:
`RecordScanner.unchecked` then says where.
"""

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Header

from hertzloop.recordings.file_format import LIBRARY
from hertzloop.recordings.mcap_records import (
    HEAD,
    MAGIC,
    RECORD_BYTES,
    CorruptRecord,
    McapRecord,
    chunk_head,
    inner_records,
    parsed,
    unpack_chunk,
)

# A whole file may unpack to the larger of these: 20 million steps are 1.6 GB, and samples do
# not shrink to a thousandth.
TOTAL_BYTES, TOTAL_RATIO = 2 << 30, 1000
_WINDOW = 1 << 20
_LENGTHS = {Opcode.HEADER: 8, Opcode.METADATA: 8, Opcode.ATTACHMENT: 36, Opcode.CHUNK: 40}
_EXACT = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
# Bytes at the start, and sizes of the lengths with which the following pieces begin. For kinds
# without a checksum, or with one that may be left out: the pieces have to fill the record.
_PIECES: dict[int, tuple[int, tuple[int, ...]]] = {
    Opcode.HEADER: (0, (4, 4)),
    Opcode.METADATA: (0, (4, 4)),
    Opcode.MESSAGE_INDEX: (2, (4,)),
    Opcode.SCHEMA: (2, (4, 4, 4)),
    Opcode.CHANNEL: (4, (4, 4, 4)),
    Opcode.ATTACHMENT: (16, (4, 4, 8)),
}
_CHECKSUM = {Opcode.ATTACHMENT: 4}  # bytes after the pieces
_CHECKED = (Opcode.CHUNK, Opcode.ATTACHMENT)  # kinds with a checksum of their own
_CHAIN = 4  # so many records that follow one another are no coincidence


@dataclass
class RecordScanner:
    """Finds the records of a file, and goes on behind damaged bytes.

    Attributes:
        handle: File descriptor of the open file.
        size: Length of the file, bytes.
        damage: Sentences on the damage, as far as the file was read.
        late_channels: Topics by channel, as the summary at the end of the file repeats them.
        false_heads: Bytes at which a record seemed to begin and does not.
        unchecked: First bytes of records without a checksum.
    """

    handle: int
    size: int
    damage: list[str] = field(default_factory=list)
    late_channels: dict[int, str] = field(default_factory=dict)
    false_heads: set[int] = field(default_factory=set)
    unchecked: set[int] = field(default_factory=set)
    checked: int = 0  # bytes, packed and unpacked

    def read(self, at: int, length: int) -> bytes:
        """Return `length` bytes from byte `at` on, fewer at the end of the file."""
        return os.pread(self.handle, length, at)

    @cached_property
    def header(self) -> Header:
        """Which program wrote the file, and its profile; empty if the header cannot be read."""
        nothing = Header(profile="", library="")
        try:
            opcode, length = self.head(len(MAGIC))
            header = Header.read(ReadDataStream(BytesIO(self.read(len(MAGIC) + HEAD.size, length))))
        except Exception:  # the mcap library raises errors of many kinds for damaged bytes
            return nothing
        return header if opcode == Opcode.HEADER else nothing

    @property
    def is_ours(self) -> bool:
        """Whether hertzloop wrote the file, which leaves no checksum out, or nobody knows."""
        return self.header.library in ("", LIBRARY)

    def _note_missing_checksum(self, at: int) -> None:
        """Note that the record at a byte has no checksum. Raises CorruptRecord if it must have
        one."""
        if self.is_ours:
            raise CorruptRecord("a checksum is missing")
        self.unchecked.add(at)

    def records(self) -> Iterator[McapRecord]:
        """Yield all records that can be read; the content of a chunk is checked and unpacked.

        A damaged length may span good records. After damage, those that have a checksum are
        searched for and come last.
        """
        verified: list[tuple[int, int]] = []
        for record in self._one_after_another():
            if self._is_verified(record):
                verified.append((record.at, record.at + HEAD.size + record.length))
            yield record
        if self.damage:
            end = len(MAGIC)
            for first, after in [*verified, (self.size, self.size)]:
                yield from self._skipped(end, first)
                end = after

    def _one_after_another(self) -> Iterator[McapRecord]:
        at, whole = len(MAGIC), True
        if self.read(0, len(MAGIC)) != MAGIC:
            self._report(0, len(MAGIC), "it does not begin as an MCAP file")
            at = at if self._continues(at) else self._next_record(0)
        while 0 <= at < self.size:
            opcode = length = 0
            try:
                opcode, length = self.head(at)
                content = self.content(opcode, at, length)
            except CorruptRecord as error:
                after = at + HEAD.size + length
                trusted = length and self._continues(after)
                found = after if trusted else self._next_record(at + 1)
                self._report(at, found if found >= 0 else self.size, str(error))
                self.false_heads.add(at)
                at, whole = found, False
                continue
            if opcode == Opcode.DATA_END:
                self._check_data(at, content, whole)
                self._check_summary(at + HEAD.size + length)
                return
            # A message outside of a chunk has no checksum: after damage it is not believed.
            if whole or opcode != Opcode.MESSAGE:
                yield McapRecord(opcode, at, length, content)
            at += HEAD.size + length
        if whole:
            self.damage.append("the file ends where more data were expected")

    def _skipped(self, start: int, end: int) -> Iterator[McapRecord]:
        """Yield records with a checksum from byte `start` to `end`."""
        reached = start
        for at in self._candidates(start, end, _CHECKED):
            if at < reached or at in self.false_heads:
                continue
            with suppress(CorruptRecord):
                opcode, length = self.head(at)
                if at + HEAD.size + length > end:
                    continue
                record = McapRecord(opcode, at, length, self.content(opcode, at, length))
                if self._is_verified(record):
                    yield record
                    reached = at + HEAD.size + length

    def reread(self, record: McapRecord) -> McapRecord:
        """Return a record with its content read anew.

        Raises:
            CorruptRecord: the file was changed.
        """
        content = self.read(record.at + HEAD.size, record.length)
        if record.opcode == Opcode.CHUNK:
            content = unpack_chunk(content)
        return record._replace(content=content)

    def _report(self, first: int, end: int, why: str) -> None:
        self.damage.append(f"bytes {first} to {end - 1} of {self.size} are damaged: {why}")

    def head(self, at: int) -> tuple[int, int]:
        """Return kind and length of the record at a byte. Raises CorruptRecord."""
        head = self.read(at, HEAD.size)
        if len(head) < HEAD.size:
            raise CorruptRecord("a record is cut off")
        opcode, length = HEAD.unpack(head)
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END:
            raise CorruptRecord(f"no record begins with {opcode}")
        if length > self.size - at - HEAD.size:
            raise CorruptRecord("a record is cut off, or its length is damaged")
        if length > RECORD_BYTES:
            raise CorruptRecord(f"a record of {length} bytes is larger than any of a recording")
        if length < _LENGTHS.get(opcode, 0) or length != _EXACT.get(opcode, length):
            raise CorruptRecord(f"a record of kind {opcode} has {length} bytes")
        return opcode, length

    def content(self, opcode: int, at: int, length: int) -> bytes:
        """Return the content of a record as `McapRecord` has it. Raises CorruptRecord if its
        checks fail."""
        if opcode == Opcode.CHUNK_INDEX:
            return b""
        if opcode in _CHECKED:
            self._count(length)
        content = self.read(at + HEAD.size, length)
        if len(content) < length:
            raise CorruptRecord("a record is cut off")
        if opcode in _PIECES:  # each after its length, they have to fill the record
            end, sizes = _PIECES[opcode]
            for size in sizes:
                end += size + int.from_bytes(content[end : end + size], "little")
            if end + _CHECKSUM.get(Opcode(opcode), 0) != length:
                raise CorruptRecord(f"the lengths in a record of kind {opcode} do not agree")
        if opcode in (Opcode.MESSAGE_INDEX, Opcode.HEADER):
            return b""
        if opcode == Opcode.ATTACHMENT:
            [checksum] = struct.unpack("<I", content[-4:])
            if not checksum:
                self._note_missing_checksum(at)
            elif checksum != zlib.crc32(content[:-4]):
                raise CorruptRecord("the checksum of an attachment does not fit")
        if opcode == Opcode.CHUNK:
            chunk = chunk_head(content, length)
            self._count(chunk.size)
            if not chunk.checksum:
                self._note_missing_checksum(at)
            content = unpack_chunk(content)
        return content

    def _is_verified(self, record: McapRecord) -> bool:
        return record.opcode in _CHECKED and record.at not in self.unchecked

    def _count(self, size: int) -> None:
        """Count bytes that are checked. Raises CorruptRecord if they are too many: a hostile file
        could keep the reader busy."""
        if self.checked + size > max(TOTAL_BYTES, TOTAL_RATIO * self.size):
            raise CorruptRecord(
                f"what is packed in {self.size} bytes is more than a recording may hold"
            )
        self.checked += size

    def _check_data(self, at: int, content: bytes, whole: bool) -> None:
        """Compare the checksum over all data. After damage it cannot fit, and is not reported."""
        checksum = 0
        for first in range(0, at, _WINDOW):
            checksum = zlib.crc32(self.read(first, min(_WINDOW, at - first)), checksum)
        [announced] = struct.unpack("<I", content)
        if not (announced or self.is_ours):
            self.unchecked.add(at)
        elif whole and announced != checksum:
            self.damage.append("the checksum over all data does not fit, or is missing")
        elif whole:
            self.unchecked.clear()  # it covers them

    def _check_summary(self, start: int) -> None:
        """Check that the data are followed by summary, footer and magic bytes, and nothing else."""
        end = self.size - 37  # of the summary: footer and magic bytes follow
        rest = self.read(start, min(self.size - start, RECORD_BYTES))
        found = rest.find(HEAD.pack(Opcode.FOOTER, 20), max(end - start, 0))
        try:
            for opcode, content in inner_records(rest[: max(end - start, 0)]):
                if opcode == Opcode.CHANNEL:
                    channel = parsed(Channel, content, "a channel")
                    self.late_channels[channel.id] = channel.topic
        except CorruptRecord:
            self.late_channels.clear()
        if end < start or start + found != end or rest[-8:] != MAGIC:
            self._report(start, self.size, "the footer is not the end of the file")
            return
        footer = Footer.read(ReadDataStream(BytesIO(rest[end - start + HEAD.size :])))
        announced = footer.summary_crc
        if announced != zlib.crc32(rest[:-12]) and (announced or self.is_ours):
            self._report(start, self.size, "the checksum of the summary does not fit")

    def _continues(self, at: int) -> bool:
        """Whether several records follow one another from this byte on, or the file ends here."""
        for _ in range(_CHAIN):
            if at == self.size - 8:
                return self.read(at, 8) == MAGIC
            try:
                _, length = self.head(at)
            except CorruptRecord:
                return False
            at += HEAD.size + length
        return True

    def _next_record(self, start: int) -> int:
        """Return the first byte from `start` on at which a record begins; -1 without one."""
        kinds = range(Opcode.HEADER, Opcode.DATA_END + 1)
        found = (at for at in self._candidates(start, self.size, kinds) if self._continues(at))
        return next(found, -1)

    def _candidates(self, start: int, end: int, kinds: Sequence[int]) -> Iterator[int]:
        """Yield bytes from `start` to `end` at which a record of these kinds may begin."""
        for first in range(start, end, _WINDOW):
            window = np.frombuffer(self.read(first, min(_WINDOW, end - first) + 8), np.uint8)
            count = len(window) - 8
            if count <= 0:
                break
            may = np.isin(window[:count], np.array(kinds, np.uint8))
            for shift in (5, 6, 7, 8):  # no length reaches 4 GiB
                may &= window[shift : shift + count] == 0
            yield from (first + offset for offset in np.flatnonzero(may).tolist())
