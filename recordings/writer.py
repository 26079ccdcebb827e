"""One run in one MCAP file: the bus's own bytes, at simulated times; and the recorder of a run."""

import errno
import fcntl
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from hertzloop.bus import sequence_checker, streams
from hertzloop.bus.messages_pb2 import Hello

SCENE_ATTACHMENT = "scene.toml"
LAW_ATTACHMENT = "law"
RUN_METADATA, RESULT_METADATA = "run", "result"
LIBRARY, EXPORT_LIBRARY = "hertzloop", "hertzloop export"  # in the headers of files
TOPICS = tuple(dict.fromkeys(stream.topic for stream in streams.STREAMS.values()))
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
            self._writer.start(profile="hertzloop", library=LIBRARY)
        return self._writer

    def scene(self, text: str, metadata: dict[str, str], law: str = "") -> None:
        """What is recorded, and the text of its law; written first, so that it survives whatever
        happens."""

        def write() -> None:
            writer = self._begun()
            writer.add_attachment(0, 0, SCENE_ATTACHMENT, "application/toml", text.encode())
            if law:
                writer.add_attachment(0, 0, LAW_ATTACHMENT, "text/plain", law.encode())
            writer.add_metadata(RUN_METADATA, metadata)
            writer.flush()

        self._guarded(write)

    def law(self, text: str) -> None:
        """The text of the law, where that comes after the scene."""
        self._guarded(
            lambda: self._begun().add_attachment(0, 0, LAW_ATTACHMENT, "text/plain", text.encode())
        )

    def write(self, stream: str, payload: bytes, sequence: int, time_ns: int) -> None:
        """One message of a stream at a simulated time, 0 to LAST_NS."""
        if not 0 <= time_ns <= streams.LAST_NS:
            raise RecordingError(
                f"stream '{stream}' sequence {sequence} is at {time_ns} ns; simulated time runs "
                f"from 0 to {streams.LAST_NS} ns"
            )
        self._guarded(
            lambda: self._begun().add_message(
                self._channel(stream), time_ns, payload, time_ns, sequence
            )
        )
        now = time.monotonic()
        if now - self._flushed > _FLUSH_EVERY_S:
            self._flushed = now
            self._guarded(lambda: self._begun().flush())

    def finish(self, metadata: dict[str, str]) -> None:
        """Write the outcome and the index, and close. Where nothing was written, leave the file
        as it was: absent, or with the old content."""

        def write() -> None:
            self._begun().add_metadata(RESULT_METADATA, metadata)
            self._begun().finish()

        try:
            if self._writer is not None:
                self._guarded(write)
            elif self._is_new:
                self._guarded(self.path.unlink)
        finally:
            self._guarded(self._file.close)

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

    def _guarded(self, action: Callable[[], object]) -> None:
        try:
            action()
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


def described_by(hello: Hello) -> dict[str, str]:
    """What a recording says of its run, from the hello."""
    pace = {"pace": f"{hello.pace:g}"} if hello.pace else {}
    repeats = {"repeats": f"{hello.repeats:x}"} if hello.repeats else {}
    return {
        "scene": hello.scene,
        "run_id": f"{hello.run_id:x}",
        "seed": str(hello.seed),
        "steps": str(hello.steps),
        "step_ns": str(hello.step_ns),
        "versions": hello.versions,
        "law": hello.law,
        "law_digest": hello.law_digest,
        **pace,
        **repeats,
    }


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
                f"{path} exists. Choose another name with --out, or add --overwrite."
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
        raise RecordingError(
            f"another run is writing {path}. Choose another name with --out."
        ) from None


class Recorder:
    """Feed it every message of a run; `done` once both roles have announced their end."""

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        self._writer = RecordingWriter(path, overwrite)
        self.checker = sequence_checker.SequenceChecker()
        self.faults: list[str] = []
        self._ended: dict[str, Any] = {}
        self._time_ns = self._end_ns = 0
        self._scene = ""  # where the hello leaves out some of it
        self._closed = False

    @property
    def done(self) -> bool:
        """Whether plant and controller have both ended."""
        return {streams.PLANT, streams.CONTROLLER} <= set(self._ended)

    @property
    def counters(self) -> dict[str, sequence_checker.Counter]:
        """Messages and samples by stream."""
        return self.checker.counters

    def handle(self, envelope: streams.Envelope) -> None:
        """Check and write one message. Raises StreamFault or RecordingError."""
        try:
            block = self.checker.accept(envelope)
        except streams.StreamFault as error:
            raise self.checker.explained(error) from error
        header: Any = block.header
        stream = envelope.stream
        if stream == "hello":
            scene = self._scene or header.scene_toml
            self._writer.scene(scene, described_by(header), header.law_source)
            self._end_ns = header.steps * header.step_ns
        elif stream == "scene":
            self._scene = header.scene_toml
        elif stream == "law":
            self._writer.law(header.source)
        if hasattr(header, "first_step"):
            self._time_ns = header.first_step * header.step_ns
        elif streams.STREAMS[stream].topic == "/events":
            # Not ToNanoseconds(): it refuses what is out of the calendar.
            at = header.timestamp
            self._time_ns = at.seconds * 1_000_000_000 + at.nanos
        elif streams.STREAMS[stream].once:
            self._time_ns = 0 if stream in ("scene", "hello", "law") else self._end_ns
        sequence = self.counters[stream].messages - 1
        self._writer.write(stream, envelope.payload, sequence, self._time_ns)
        if stream.startswith("end/"):
            self._ended[header.role] = header
            if header.fault:
                self.faults.append(header.fault)

    def reconcile(self) -> None:
        """Compare announced and received counts, and what the controller worked by with what the
        plant announced. Raises StreamFault for a difference or a role that never announced its
        end; after a fault that one announced, a difference is noted beside it."""
        try:
            for role in (streams.PLANT, streams.CONTROLLER):
                if role not in self._ended:
                    raise streams.StreamFault(
                        f"the {role} never announced its end; its last messages may be missing"
                    )
                self.checker.reconcile(self._ended[role])
        except streams.StreamFault as difference:
            if not self.faults:
                raise
            self.faults.append(str(difference))

    def close(self, fault: str = "") -> None:
        """Finish the file, whatever has happened; `fault` says why it is not complete."""
        if self._closed:
            return
        self._closed = True
        told = [words for words in dict.fromkeys([*self.faults, fault]) if words]
        # One role passes on what another has said.
        faults = "; ".join(f for f in told if not any(f in more for more in told if more != f))
        counts = {name: f"{c.messages} {c.samples}" for name, c in self.counters.items()}
        self._writer.finish({"complete": "no" if faults else "yes", "fault": faults, **counts})
