"""Records of an MCAP file, from bytes that may be damaged.

No length and no size is believed before it is checked against what is there.
Source of the format: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Message

MAGIC = b"\x89MCAP0\r\n"
RECORD_BYTES = 64 << 20  # at most, of a record, and of a chunk when unpacked
HEAD = struct.Struct("<BQ")  # of every record: kind, length of the content
_CHUNK = struct.Struct("<QQQII")  # times, size unpacked, checksum, length of the next name
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


class CorruptRecord(Exception):
    """Why bytes of a file are not the record that they should be."""


class McapRecord(NamedTuple):
    """A record of the outermost level of a file.

    Attributes:
        opcode: Kind of the record.
        at: First byte in the file.
        length: Bytes of the content in the file.
        content: Content, that of a chunk unpacked; empty for kinds that hertzloop does not read.
    """

    opcode: int
    at: int
    length: int
    content: bytes


class ChunkHead(NamedTuple):
    """What a chunk says of its data: compression, size unpacked, checksum (0 for none), first
    byte."""

    compression: str
    size: int
    checksum: int
    at: int


def chunk_head(content: bytes, length: int) -> ChunkHead:
    """Return what a chunk of `length` bytes says of its data, from its first bytes.

    Raises:
        CorruptRecord: the lengths in it do not agree, or its data would be too large.
    """
    if len(content) < _CHUNK.size + 8:
        raise CorruptRecord("a chunk is too short")
    _, _, size, checksum, name_length = _CHUNK.unpack_from(content)
    at = _CHUNK.size + name_length
    if name_length > 8 or len(content) < at + 8:
        raise CorruptRecord("a chunk's compression has no name")
    name = content[_CHUNK.size : at].decode(errors="replace")
    [packed] = struct.unpack_from("<Q", content, at)
    if name not in ("", "zstd", "lz4") or at + 8 + packed != length:
        raise CorruptRecord("the lengths in a chunk do not agree")
    if size > RECORD_BYTES:
        raise CorruptRecord(
            f"a chunk of {length} bytes would unpack to {size}, {RECORD_BYTES} at most"
        )
    return ChunkHead(name, size, checksum, at + 8)


def unpack_chunk(content: bytes) -> bytes:
    """Return the records in a chunk, as bytes.

    Raises:
        CorruptRecord: the data are too large, or not what was written, as far as a checksum tells.
    """
    head = chunk_head(content, len(content))
    packed = content[head.at :]
    try:
        if head.compression == "zstd":
            reader = zstandard.ZstdDecompressor(max_window_size=RECORD_BYTES)
            with reader.stream_reader(packed) as stream:
                data = stream.read(head.size + 1)
        elif head.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, head.size + 1)
        else:
            data = packed
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise CorruptRecord(f"a chunk cannot be unpacked ({error})") from error
    if len(data) != head.size:
        raise CorruptRecord(f"a chunk does not unpack to the {head.size} bytes it announces")
    if head.checksum and head.checksum != zlib.crc32(data):
        raise CorruptRecord("the checksum of a chunk does not fit")
    return data


def inner_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of records that follow one another.

    Raises:
        CorruptRecord: a record goes on beyond the data.
    """
    at = 0
    while at < len(data):
        if at + HEAD.size > len(data):
            raise CorruptRecord("a record in a chunk is cut off")
        opcode, length = HEAD.unpack_from(data, at)
        at += HEAD.size
        if length > len(data) - at:
            raise CorruptRecord("a record in a chunk is longer than the chunk")
        yield opcode, data[at : at + length]
        at += length


def message_of(content: bytes) -> Message:
    """Return the message in a record of that kind. Raises CorruptRecord."""
    if len(content) < _MESSAGE.size:
        raise CorruptRecord("a message is too short")
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    return Message(channel, log_time, content[_MESSAGE.size :], publish_time, sequence)


def parsed(kind: Any, content: bytes, name: str) -> Any:
    """Return a record as the mcap library reads it.

    Args:
        kind: Class of `mcap.records`.
        content: Content of the record.
        name: What the error calls it.

    Raises:
        CorruptRecord: the library cannot read it.
    """
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # the library raises errors of many kinds for damaged bytes
        raise CorruptRecord(f"{name} cannot be read ({type(error).__name__})") from error
