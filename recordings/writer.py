"""Writer of a recording: the bytes of the bus in one MCAP file, at simulated times."""

import errno
import fcntl
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from hertzloop.bus import streams
from hertzloop.recordings.file_format import (
    FORMAT_KEY,
    FORMAT_VERSION,
    LAW_ATTACHMENT,
    LIBRARY,
    PROFILE,
    RESULT_METADATA,
    RUN_METADATA,
    SCENE_ATTACHMENT,
    TOPICS,
)

_CHUNK_BYTES = 1 << 20
_FLUSH_EVERY_S = 0.05


class RecordingError(RuntimeError):
    """A recording cannot be written or read. The message says why."""

    exit_status = 1


class UnreadableRecording(RecordingError):
    """A file cannot be read, or is not a recording that can be used."""

    exit_status = 2


class NotRecorded(RecordingError):
    """A recording cannot be written, for a `reason` of the system."""

    def __init__(self, message: str, reason: OSError) -> None:
        super().__init__(message)
        self.reason = reason


class RecordingWriter:
    """Writes messages as they come; a killed process loses at most the last 50 ms.

    The file is locked until it is closed. What an existing one holds is replaced by the first
    thing that is written, and not before. Raises RecordingError when the file exists (unless
    `overwrite`), is another run's, or cannot be written.
    """

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        self.path = path
        self._file, self._is_new = _opened(path, overwrite)
        self._writer: Writer | None = None
        self._channels: dict[str, int] = {}
        self._flushed = time.monotonic()

    def _begun(self) -> Writer:
        """The writer, with the file's old content gone."""
        if self._writer is None:
            if stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
                self._file.truncate(0)
            # Chunks have checksums anyway; the one over all data covers scene and metadata, too.
            self._writer = Writer(
                self._file, _CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
            )
            self._writer.start(profile=PROFILE, library=LIBRARY)
        return self._writer

    def scene(self, text: str, metadata: dict[str, str]) -> None:
        """Write the scene and the description of the run, with the format version.

        Call it first: what stands at the start of the file survives a killed process.
        """
        with self._guarded():
            writer = self._begun()
            writer.add_attachment(0, 0, SCENE_ATTACHMENT, "application/toml", text.encode())
            writer.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT_VERSION})
            writer.flush()

    def law(self, text: str) -> None:
        """Write the text of the law."""
        with self._guarded():
            self._begun().add_attachment(0, 0, LAW_ATTACHMENT, "text/plain", text.encode())

    def write(self, stream: str, payload: bytes, sequence: int, time_ns: int) -> None:
        """One message of a stream at a simulated time, 0 to LAST_NS."""
        if not 0 <= time_ns <= streams.LAST_NS:
            raise RecordingError(
                f"stream '{stream}' sequence {sequence} is at {time_ns} ns; simulated time runs "
                f"from 0 to {streams.LAST_NS} ns"
            )
        with self._guarded():
            writer, now = self._begun(), time.monotonic()
            writer.add_message(self._channel(stream), time_ns, payload, time_ns, sequence)
            if now - self._flushed > _FLUSH_EVERY_S:
                self._flushed = now
                writer.flush()

    def finish(self, metadata: dict[str, str]) -> None:
        """Write the outcome and the index, and close. Where nothing was written, leave the file
        as it was: absent, or with the old content."""
        with self._guarded(), self._file:
            if self._writer is not None:
                self._writer.add_metadata(RESULT_METADATA, metadata)
                self._writer.finish()
            elif self._is_new:
                self.path.unlink()

    def _channel(self, stream: str) -> int:
        if not self._channels:
            # All at once, in the order of the table: so their numbers are known even where the
            # part of the file that names them is lost.
            for topic in TOPICS:
                entry = next(s for s in streams.STREAMS.values() if s.topic == topic)
                shown = entry.recorded_as or entry.message
                schema = self._begun().register_schema(
                    shown.DESCRIPTOR.full_name,
                    "protobuf",
                    _schema_of(shown, entry.message).SerializeToString(),
                )
                self._channels[topic] = self._begun().register_channel(
                    topic=topic, message_encoding="protobuf", schema_id=schema
                )
        return self._channels[streams.STREAMS[stream].topic]

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Raise NotRecorded where the system does not write."""
        try:
            yield
        except OSError as error:
            kept = "; the data written so far are readable" if self._channels else ""
            raise NotRecorded(
                f"cannot write the recording {self.path}: {error.strerror or error}{kept}", error
            ) from error


def _schema_of(shown: type[Message], message: type[Message]) -> FileDescriptorSet:
    """The schema of `shown`, with the fields that only `message` has: viewers know `shown` by its
    name, and programs find every field."""
    schema: FileDescriptorSet = build_file_descriptor_set(shown)
    if shown is message:
        return schema
    made = next(m for m in schema.file[-1].message_type if m.name == shown.DESCRIPTOR.name)
    known = {field.number for field in made.field}
    message.DESCRIPTOR.CopyToProto(whole := DescriptorProto())
    made.oneof_decl.extend(whole.oneof_decl)
    for field in whole.field:
        if field.number in known:
            continue
        if kind := message.DESCRIPTOR.fields_by_number[field.number].enum_type:
            kind.CopyToProto(made.enum_type.add())
            field.type_name = f".{shown.DESCRIPTOR.full_name}.{kind.name}"
        made.field.append(field)
    return schema


def _opened(path: Path, overwrite: bool) -> tuple[BinaryIO, bool]:
    """The file, open and locked, with what it holds; and whether it is new."""
    # A pipe without a reader is refused: nobody waits for one.
    flags = os.O_WRONLY | os.O_CLOEXEC | os.O_CREAT | os.O_NONBLOCK
    while True:
        try:
            try:
                handle, is_new = os.open(path, flags | os.O_EXCL, 0o666), True
            except FileExistsError:
                if not overwrite:
                    raise
                handle, is_new = os.open(path, flags, 0o666), False
        except FileExistsError:
            raise RecordingError(
                f"{path} exists. Choose another name, or say that it may be overwritten."
            ) from None
        except OSError as error:
            reason = error.strerror
            raise RecordingError(f"cannot create the recording {path}: {reason}") from error
        _lock(handle, path)
        # Between opening and locking, another run may have taken its new file away.
        if path.exists() and os.path.samestat(os.fstat(handle), path.stat()):
            return os.fdopen(handle, "wb"), is_new
        os.close(handle)


def _lock(handle: int, path: Path) -> None:
    """Take the system's own lock on a file: it is gone with its process, however that ends."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            return  # a file system without locks is no reason not to record
        os.close(handle)
        raise RecordingError(f"another run is writing {path}. Choose another name.") from None
