"""An MCAP file, read by the mcap package up to the first damage.

No length and no size in a file is believed before it is compared with what is there: a small file
takes little memory, whatever it says.
"""

import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, cast

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Chunk, DataEnd, Footer, Header, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from hertzloop.common.missing_files import why_unreadable
from hertzloop.recordings.file_format import LIBRARY
from hertzloop.recordings.writer import UnreadableRecording

RECORD_BYTES = 64 << 20  # at most, of a record, and of a chunk when unpacked
# All chunks of a file may unpack to the larger of these: 20 million steps are 1.6 GB, and samples
# do not shrink to a thousandth.
TOTAL_BYTES, TOTAL_RATIO = 2 << 30, 1000
_SUMMARY_CRC_BYTES = 4  # at the end of the footer


class DamagedRecord(Exception):
    """Why a record of a file cannot be what was written."""


class McapFile:
    """A file whose records can be read.

    Attributes:
        header: What the file says of its writer.
        damage: Where and why reading ended early; empty while there is no damage.
        unchecked: Number of parts that no checksum covers: another program wrote them.

    Raises UnreadableRecording: in the constructor and while reading, if the system does not read
    the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header = Header(profile="", library="")
        self.damage = ""
        self.unchecked = self._unpacked = self._at = self._data_end = 0
        with self._reading():
            # Without waiting for a writer, should it be a pipe.
            handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            os.close(handle)
            kind = "Is a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise UnreadableRecording(f"cannot read {path}: {kind}")
        self._file, self.size = os.fdopen(handle, "rb"), status.st_size

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            why = why_unreadable(self.path, error, "Give the path of a recording.")
            raise UnreadableRecording(f"cannot read {self.path}: {why}") from error

    def read(self, length: int) -> bytes:
        """Return the next bytes, as many as wanted. Raises DamagedRecord."""
        data = self._file.read(length) if 0 <= length <= self.size - self._at else b""
        if len(data) < length:
            raise DamagedRecord("the file is cut off, or a length in it is damaged")
        self._at += length
        return data

    def records(self) -> Iterator[McapRecord]:
        """Yield the records up to the first damage, those of a chunk instead of the chunk."""
        source = cast(IO[bytes], self)  # of a file, the package calls `read` alone
        reader = StreamReader(
            source, emit_chunks=True, validate_crcs=True, record_size_limit=RECORD_BYTES
        )
        start = 0
        with self._reading(), self._file:
            try:
                for record in reader.records:
                    yield from self._checked(record)
                    start = self._at
                if self._at < self.size:
                    raise DamagedRecord("bytes follow the end of the data")
            except OSError:
                raise
            except Exception as error:  # the mcap package raises errors of many kinds
                why = str(error) or type(error).__name__
                self.damage = f"byte {start} of {self.size}: {why}"

    def _checked(self, record: McapRecord) -> list[McapRecord]:
        """Return what a record holds. Raises DamagedRecord, or an error of the mcap package."""
        if isinstance(record, Header):
            self.header = record
        elif isinstance(record, Chunk):
            self._need_checksum(record.uncompressed_crc)
            return breakup_chunk(self._unpack(record), validate_crc=True)
        elif isinstance(record, Attachment):
            self._check_attachment(record)
        elif isinstance(record, Message) and self._is_ours:
            raise DamagedRecord("a message is outside of the chunks")
        elif isinstance(record, DataEnd):
            if record.data_section_crc:
                self.unchecked = 0  # it covers them
            else:
                self._need_checksum(0)
            self._data_end = self._at
        elif isinstance(record, Footer):
            self._check_summary(record)
        return [record]

    @property
    def _is_ours(self) -> bool:
        """Whether hertzloop wrote the file, which leaves no checksum out, or nobody knows."""
        return self.header.library in ("", LIBRARY)

    def _need_checksum(self, checksum: int) -> None:
        """Count a part without a checksum. MCAP lets other programs leave them out."""
        if checksum == 0:
            if self._is_ours:
                raise DamagedRecord("a checksum is missing")
            self.unchecked += 1

    def _check_attachment(self, record: Attachment) -> None:
        """Compare an attachment that was just read with its checksum: mcap does not."""
        record.write(builder := RecordBuilder())
        found = os.pread(self._file.fileno(), 4, self._at - 4)
        if found == bytes(4):
            self._need_checksum(0)
        elif found != builder.end()[-4:]:
            raise DamagedRecord("the checksum of an attachment does not fit")

    def _check_summary(self, footer: Footer) -> None:
        """Compare the summary with its checksum: mcap does not."""
        end = self._at - _SUMMARY_CRC_BYTES
        data = os.pread(self._file.fileno(), end - self._data_end, self._data_end)
        if footer.summary_crc != zlib.crc32(data) and (footer.summary_crc or self._is_ours):
            raise DamagedRecord("the checksum of the summary does not fit")

    def _unpack(self, chunk: Chunk) -> Chunk:
        """Return a chunk without compression. Raises DamagedRecord if it would be too large."""
        size = chunk.uncompressed_size
        self._unpacked += size
        if size > RECORD_BYTES:
            raise DamagedRecord(f"a chunk would unpack to {size} bytes, {RECORD_BYTES} at most")
        if self._unpacked > max(TOTAL_BYTES, TOTAL_RATIO * self.size):
            raise DamagedRecord("the chunks unpack to more than a recording may hold")
        data = chunk.data
        if chunk.compression == "zstd":
            reader = zstandard.ZstdDecompressor(max_window_size=RECORD_BYTES).stream_reader(data)
            data = reader.read(size + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1)
        if len(data) != size:
            raise DamagedRecord(f"a chunk does not unpack to the {size} bytes it announces")
        return replace(chunk, compression="", data=data)
