"""One run in one MCAP file: the bus's own bytes, at simulated times."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from bus.streams import STREAMS

SCENE_ATTACHMENT = "scene.toml"
RUN_METADATA, RESULT_METADATA = "run", "result"
_CHUNK_BYTES = 1 << 20
_FLUSH_EVERY_S = 0.05


class RecordingError(RuntimeError):
    """The recording cannot be written or read; the sentence says why."""


class RecordingWriter:
    """Writes messages as they come; a killed process loses at most the last 50 ms.

    Raises RecordingError when the file exists (unless `overwrite`) or cannot be written.
    """

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        self.path = path
        try:
            self._file: BinaryIO = path.open("wb" if overwrite else "xb")
        except FileExistsError:
            raise RecordingError(
                f"{path} exists; choose another name with --out, or allow it with --overwrite"
            ) from None
        except OSError as error:
            raise RecordingError(f"cannot create the recording {path}: {error.strerror}") from error
        # Chunks have checksums anyway; the one over all data covers scene and metadata, too.
        self._writer = Writer(
            self._file, _CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._guarded(lambda: self._writer.start(profile="hertzloop", library="hertzloop"))
        self._channels: dict[str, int] = {}
        self._flushed = time.monotonic()

    def scene(self, text: str, metadata: dict[str, str]) -> None:
        """What is recorded; written first, so that it survives whatever happens."""

        def write() -> None:
            self._writer.add_attachment(0, 0, SCENE_ATTACHMENT, "application/toml", text.encode())
            self._writer.add_metadata(RUN_METADATA, metadata)
            self._writer.flush()

        self._guarded(write)

    def write(self, stream: str, payload: bytes, sequence: int, time_ns: int) -> None:
        """One message of a stream at a simulated time."""
        self._guarded(
            lambda: self._writer.add_message(
                self._channel(stream), time_ns, payload, time_ns, sequence
            )
        )
        now = time.monotonic()
        if now - self._flushed > _FLUSH_EVERY_S:
            self._flushed = now
            self._guarded(self._writer.flush)

    def finish(self, metadata: dict[str, str]) -> None:
        """Write the outcome and the index, and close."""

        def write() -> None:
            self._writer.add_metadata(RESULT_METADATA, metadata)
            self._writer.finish()

        try:
            self._guarded(write)
        finally:
            self._guarded(self._file.close)

    def _channel(self, stream: str) -> int:
        entry = STREAMS[stream]
        if entry.topic not in self._channels:
            schema = register_schema(self._writer, entry.message)
            self._channels[entry.topic] = self._writer.register_channel(
                topic=entry.topic, message_encoding="protobuf", schema_id=schema
            )
        return self._channels[entry.topic]

    def _guarded(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            raise RecordingError(
                f"cannot write the recording {self.path}: {error.strerror or error}; what was "
                "written until now is readable"
            ) from error
