"""A recording's samples for other tools: tables, array files, one MCAP message a sample.

The per-sample MCAP has the schema `foxglove.JointState`, which Foxglove documents: position (m),
velocity (m/s), acceleration (m/s^2) and effort (N), each only where there is one. A topic is a
body or a signal; log time = publish time = simulated time.
"""

import csv
import json
import zipfile
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from io import FileIO, RawIOBase
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.file_format import (
    EXPORT_LIBRARY,
    LAW_ATTACHMENT,
    RUN_METADATA,
    SCENE_ATTACHMENT,
)
from hertzloop.recordings.joined_stream import Arrays, JoinedStream
from hertzloop.recordings.recording import Event, Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.whole_files import NotWritten, whole_file

WINDOW_STEPS = 1 << 16
STREAMS = ("truth", "daq", "force")

Label = tuple[str, str]  # unit, meaning
Piece = tuple[np.ndarray, Arrays]  # steps, and columns of the same length


@dataclass(frozen=True)
class Samples:
    """What is exported: a recording, the labels of its columns, and the span of simulated time,
    both ends included, ns."""

    recording: Recording
    labels: Mapping[str, Label]
    span_ns: tuple[int, int] = (0, LAST_NS)

    @cached_property
    def names(self) -> dict[str, list[str]]:
        """Names of the columns, by stream."""
        return {name: list(self.renamed(name, self._empty(name))) for name in STREAMS}

    def stream(self, name: str) -> JoinedStream:
        """One of STREAMS."""
        found = getattr(self.recording, name)
        assert isinstance(found, JoinedStream)
        return found

    def recorded_ns(self) -> tuple[int, int] | None:
        """Simulated times of the first and the last sample of the recording, ns; None without
        samples."""
        streams = [stream for name in STREAMS if (stream := self.stream(name)).samples]
        if not streams:
            return None
        first = min(stream.time_ns_at(0) for stream in streams)
        return first, max(stream.time_ns_at(stream.samples - 1) for stream in streams)

    def holds_any(self) -> bool:
        """Whether a stream has a sample within the span."""
        low, high = self.span_ns
        for stream in map(self.stream, STREAMS):
            at = bisect_left(range(stream.samples), low, key=stream.time_ns_at)
            if at < stream.samples and stream.time_ns_at(at) <= high:
                return True
        return False

    def _empty(self, name: str) -> Arrays:
        stream = self.stream(name)
        known = getattr(stream.arrays, "dtypes", None)
        if known is None:
            known = {key: values.dtype for key, values in stream.arrays.items()}
        return {key: np.empty(0, dtype) for key, dtype in known.items()}

    def renamed(self, name: str, arrays: Arrays) -> Arrays:
        """Columns of an export, from the fields of a message."""
        if name == "force":
            return {"command_n": arrays["force_n"]} if "force_n" in arrays else {}
        if name != "daq":
            return arrays
        found = {f"daq_{key}": arrays[key] for key in ("code", "value") if key in arrays}
        if "code" in arrays:
            found["daq_value"] = self.recording.daq.values_of(arrays)
        if "saturated" in arrays:
            found["daq_saturated"] = arrays["saturated"]
        return found

    def dtype(self, stream: str, column: str) -> np.dtype:
        """Of a column of one of STREAMS."""
        return self.renamed(stream, self._empty(stream))[column].dtype

    def label(self, column: str) -> Label:
        """Unit and meaning of a column; empty words where there are none."""
        return self.labels.get(column, ("", ""))

    def pieces(self, name: str) -> Iterator[Piece]:
        """Samples of a stream within the span, block by block. Raises RecordingError if the file
        changes meanwhile."""
        stream, at = self.stream(name), 0
        low, high = self.span_ns
        for arrays in stream.blocks():
            count = len(next(iter(arrays.values())))
            steps = stream.step_at(np.arange(at, at + count))
            at += count
            inside = (steps >= -(-low // stream.step_ns)) & (steps <= high // stream.step_ns)
            if inside.all():
                yield steps, self.renamed(name, arrays)
            elif inside.any():
                yield steps[inside], self.renamed(name, {k: v[inside] for k, v in arrays.items()})

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""
        lengths = (self.stream(name).step_ns for name in STREAMS)
        return next((length for length in lengths if length), 1)

    def windows(self) -> Iterator[dict[str, Piece]]:
        """Samples of all streams side by side: at most WINDOW_STEPS steps at a time."""
        feeds = {name: _Feed(self.pieces(name)) for name in STREAMS}
        while True:
            waiting = [feed.next_step for feed in feeds.values() if feed.next_step is not None]
            if not waiting:
                return
            end = min(waiting) + WINDOW_STEPS
            yield {
                name: piece
                for name, feed in feeds.items()
                if (piece := feed.until(end)) is not None
            }


class _Feed:
    def __init__(self, pieces: Iterator[Piece]) -> None:
        self._pieces = pieces
        self._held: Piece | None = next(pieces, None)

    @property
    def next_step(self) -> int | None:
        """Step of the next sample, None at the end."""
        return int(self._held[0][0]) if self._held else None

    def until(self, end: int) -> Piece | None:
        """All samples before step `end`, None if there are none."""
        taken: list[Piece] = []
        while self._held and self._held[0][0] < end:
            steps, arrays = self._held
            count = int(np.searchsorted(steps, end))
            taken.append((steps[:count], {k: v[:count] for k, v in arrays.items()}))
            if count < len(steps):
                self._held = steps[count:], {k: v[count:] for k, v in arrays.items()}
            else:
                self._held = next(self._pieces, None)
        if not taken:
            return None
        columns = {k: np.concatenate([arrays[k] for _, arrays in taken]) for k in taken[0][1]}
        return np.concatenate([steps for steps, _ in taken]), columns


_TIME: Label = ("ns", "simulated time")


def write_npz(samples: Samples, path: Path) -> None:
    """Arrays `truth/xi_m` and the like, with `truth/time_ns`; `metadata` is a JSON text with the
    units, the scene and the versions."""
    units = {f"{stream}/{name}": list(label) for stream, name, label in _columns(samples)}
    about = {
        "columns": units,
        "scene.toml": samples.recording.scene_toml,
        "run": samples.recording.metadata,
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("metadata.npy", "w") as entry:
            np.lib.format.write_array(entry, np.array(json.dumps(about)))
        for stream in STREAMS:
            count = sum(len(steps) for steps, _ in samples.pieces(stream))
            for name in _names(samples, stream):
                _write_array(archive, samples, stream, name, count)


def _names(samples: Samples, stream: str) -> list[str]:
    return ["time_ns", *samples.names[stream]] if samples.names[stream] else []


def _columns(samples: Samples) -> Iterator[tuple[str, str, Label]]:
    for stream in STREAMS:
        for name in _names(samples, stream):
            yield stream, name, _TIME if name == "time_ns" else samples.label(name)


def _write_array(
    archive: zipfile.ZipFile, samples: Samples, stream: str, name: str, count: int
) -> None:
    """One column of one stream: read once more, so that no more than a block is in memory."""
    is_time = name == "time_ns"
    dtype = np.dtype("<i8") if is_time else samples.dtype(stream, name)
    header = {
        "descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (count,)
    }  # fmt: skip
    with archive.open(f"{stream}/{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array_header_2_0(entry, header)
        for steps, arrays in samples.pieces(stream):
            values = steps * samples.step_ns if is_time else arrays[name]
            entry.write(np.ascontiguousarray(values, dtype).tobytes())


def write_hdf5(samples: Samples, path: Path) -> None:
    """A group a stream; every dataset has the attributes `units` and `long_name`."""
    if find_spec("h5py") is None:
        raise RecordingError("HDF5 needs h5py, which is not installed: pip install 'hertzloop[h5]'")
    import h5py  # of an extra

    with _SteadyFile(path) as steady:
        with h5py.File(steady, "w") as file:
            file.attrs["scene.toml"] = samples.recording.scene_toml
            for key, value in samples.recording.metadata.items():
                file.attrs[key] = value
            datasets: dict[str, Any] = {}
            for stream, name, (unit, meaning) in _columns(samples):
                dtype = np.dtype("<i8") if name == "time_ns" else samples.dtype(stream, name)
                made = file.create_dataset(
                    f"{stream}/{name}", (0,), dtype, maxshape=(None,), chunks=(1 << 14,),
                    compression="gzip", compression_opts=1, shuffle=True,
                )  # fmt: skip
                made.attrs["units"], made.attrs["long_name"] = unit, meaning
                datasets[f"{stream}/{name}"] = made
            for window in samples.windows():
                for stream, (steps, arrays) in window.items():
                    for name, values in {"time_ns": steps * samples.step_ns, **arrays}.items():
                        made = datasets[f"{stream}/{name}"]
                        at = made.shape[0]
                        made.resize(at + len(values), axis=0)
                        made[at:] = values
                steady.check()
        steady.check()


class _SteadyFile(FileIO):
    """A file for HDF5, which may crash the process after a write has failed: what the disk refuses
    is kept in memory, until `check` raises the error and HDF5 closes the file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._refused: list[tuple[int, bytes]] = []  # place and content
        self._error: OSError | None = None

    def check(self) -> None:
        if self._error is not None:
            raise self._error

    def write(self, data: Any) -> int:
        """Write all of `data`, or keep the rest."""
        at, done = self.tell(), 0
        try:
            while done < len(data) and self._error is None:
                done += super().write(data[done:])
        except OSError as error:
            self._error = error
        if done < len(data):
            self._refused.append((at + done, bytes(data[done:])))
        return len(data)

    def readinto(self, buffer: Any) -> int:
        """Read what was written, kept or not."""
        begin, size = self.tell(), len(buffer)
        buffer[:] = super().read(size).ljust(size, b"\0")
        for at, data in self._refused:
            first, last = max(at, begin), min(at + len(data), begin + size)
            if first < last:
                buffer[first - begin : last - begin] = data[first - at : last - at]
        return size

    def read(self, size: int | None = -1) -> Any:
        return RawIOBase.read(self, -1 if size is None else size)

    def truncate(self, size: int | None = None) -> int:
        """Set the length, or note why it cannot be set."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._error = self._error or error
            return self.tell()


_TIME_NAME = {"step": ("", "number of the step"), "time_ns": ("ns", "simulated time")}


def write_parquet(samples: Samples, path: Path) -> None:
    """Unit and meaning are metadata of each column, the scene is metadata of the file. Where a
    stream has no sample at a step, its columns are null."""
    schema = _schema(samples)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for window in samples.windows():
            writer.write_table(_table(samples, schema, window))


def write_csv(samples: Samples, path: Path) -> None:
    """Numbers have as many digits as it takes to read the same bits. Where a stream has no sample
    at a step, its cells are empty."""
    schema = _schema(samples)
    with arrow_csv.CSVWriter(path, schema) as writer:
        for window in samples.windows():
            writer.write_table(_table(samples, schema, window))


def columns_file(path: Path) -> Path:
    """The file beside a CSV export that holds the unit and the meaning of each column: remarks in
    the table itself would need an option of most programs that read it."""
    return path.with_name(f"{path.stem}-columns.csv")


def _write_columns(samples: Samples, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["column", "unit", "meaning"])
        for column in _schema(samples):
            about = (column.metadata[key].decode() for key in (b"unit", b"meaning"))
            writer.writerow([column.name, *about])


def _schema(samples: Samples) -> Any:
    def column(name: str, dtype: np.dtype, label: tuple[str, str]) -> Any:
        about = {"unit": label[0], "meaning": label[1]}
        return pa.field(name, pa.from_numpy_dtype(dtype), metadata=about)

    columns = [column(name, np.dtype(np.int64), label) for name, label in _TIME_NAME.items()]
    for stream in STREAMS:
        for name in samples.names[stream]:
            columns.append(column(name, samples.dtype(stream, name), samples.label(name)))
    recording = samples.recording
    return pa.schema(
        columns,
        {"scene.toml": recording.scene_toml, "hertzloop": json.dumps(recording.metadata)},
    )


def _table(samples: Samples, schema: Any, window: dict[str, Piece]) -> Any:
    """A piece of the table: a row for every step that any stream has."""
    steps = np.unique(np.concatenate([steps for steps, _ in window.values()]))
    columns = [pa.array(steps), pa.array(steps * samples.step_ns)]
    for stream in STREAMS:
        own, arrays = window.get(stream, (np.empty(0, np.int64), {}))
        rows = np.searchsorted(steps, own)
        missing = np.ones(len(steps), bool)
        missing[rows] = False
        for name in samples.names[stream]:
            values = np.zeros(len(steps), samples.dtype(stream, name))
            if len(rows):
                values[rows] = arrays[name]
            columns.append(pa.array(values, mask=missing if missing.any() else None))
    return pa.Table.from_arrays(columns, schema=schema)


# Topic -> stream, and field of a JointState -> column.
TOPICS: dict[str, tuple[str, dict[str, str]]] = {
    "/gap": ("truth", {"position": "xi_m", "effort": "f_c_n"}),
    "/sphere": ("truth", {"position": "xi_s_m"}),
    "/plate": ("truth", {"position": "xi_p_m", "velocity": "v_p_m_s"}),
    "/actuator": ("truth", {"position": "xi_a_m", "effort": "f_a_n"}),
    "/contact_force_slope": ("truth", {"effort": "f_c1_n"}),
    "/actuator_force_slope": ("truth", {"effort": "f_a1_n"}),
    "/deepest": ("truth", {"position": "deepest_m"}),
    "/command": ("force", {"effort": "command_n"}),
}
_DOUBLE = 1  # wire type of protobuf
_BY_UNIT = {"m": "position", "m/s": "velocity", "m/s^2": "acceleration", "N": "effort"}


@dataclass(frozen=True)
class _Topic:
    """A channel and where its values come from."""

    name: str
    channel: int
    stream: str
    columns: Mapping[str, str]  # field of a JointState -> column

    def payloads(self, arrays: Mapping[str, np.ndarray]) -> list[bytes]:
        """The messages of a piece, serialised all at once: they have one length."""
        name = JointState(name=self.name[1:]).SerializeToString()
        layout: list[tuple[str, str]] = [("name", f"V{len(name)}")]
        for key in self.columns:
            layout += [(f"tag {key}", "u1"), (key, "<f8")]
        count = len(next(iter(arrays.values())))
        packed = np.empty(count, np.dtype(layout))
        packed["name"] = np.frombuffer(name, f"V{len(name)}")
        for key, column in self.columns.items():
            packed[f"tag {key}"] = JointState.DESCRIPTOR.fields_by_name[key].number << 3 | _DOUBLE
            packed[key] = arrays[column]
        data, size = packed.tobytes(), packed.dtype.itemsize
        return [data[at : at + size] for at in range(0, len(data), size)]


def write_mcap(samples: Samples, path: Path) -> None:
    """Scene, law and description of the run are there as in the recording."""
    recording = samples.recording
    with path.open("wb") as file:
        writer = Writer(file, 1 << 20, compression=CompressionType.ZSTD)
        writer.start(profile="", library=EXPORT_LIBRARY)
        for name, media, text in (
            (SCENE_ATTACHMENT, "application/toml", recording.scene_toml),
            (LAW_ATTACHMENT, "text/plain", recording.law_source),
        ):
            if text:
                writer.add_attachment(0, 0, name, media, text.encode())
        writer.add_metadata(RUN_METADATA, recording.metadata)
        topics = _topics(writer, samples)
        log = writer.register_channel("/events", "protobuf", register_schema(writer, Log))
        low, high = samples.span_ns
        events = sorted(
            (e for e in recording.events if low <= e.time_ns <= high), key=lambda e: e.time_ns
        )
        for window in samples.windows():
            end_ns = samples.step_ns * max(int(steps[-1]) for steps, _ in window.values())
            due = [event for event in events if event.time_ns <= end_ns]
            events = events[len(due) :]
            _write_window(writer, samples, window, topics, due, log)
        _write_window(writer, samples, {}, topics, events, log)
        writer.finish()


def _topics(writer: Writer, samples: Samples) -> list[_Topic]:
    schema = register_schema(writer, JointState)
    wanted = dict(TOPICS)
    unit = samples.label("daq_value")[0]
    wanted["/measured"] = ("daq", {_BY_UNIT.get(unit, "position"): "daq_value"})
    found = []
    for topic, (stream, columns) in wanted.items():
        here = {key: name for key, name in columns.items() if name in samples.names[stream]}
        if not here:
            continue
        about = {
            key: "{1} ({0}), '{2}' of the recording".format(*samples.label(name), name)
            for key, name in here.items()
        }
        channel = writer.register_channel(topic, "protobuf", schema, about)
        found.append(_Topic(topic, channel, stream, here))
    return found


def _write_window(
    writer: Writer,
    samples: Samples,
    window: dict[str, Piece],
    topics: list[_Topic],
    events: list[Event],
    log: int,
) -> None:
    """All messages of a window in the order of their times."""
    times: list[np.ndarray] = [np.array([event.time_ns for event in events], np.int64)]
    channels: list[np.ndarray] = [np.full(len(events), log)]
    payloads = [_log(event) for event in events]
    sequence = [np.zeros(len(events), np.int64)]
    for topic in topics:
        if topic.stream in window:
            steps, arrays = window[topic.stream]
            times.append(steps * samples.step_ns)
            channels.append(np.full(len(steps), topic.channel))
            sequence.append(steps & 0xFFFFFFFF)
            payloads += topic.payloads(arrays)
    at, of, number = (np.concatenate(parts) for parts in (times, channels, sequence))
    order = np.argsort(at, kind="stable")
    for i, channel, time_ns, count in zip(
        order.tolist(), of[order].tolist(), at[order].tolist(), number[order].tolist(), strict=True
    ):
        writer.add_message(channel, time_ns, payloads[i], time_ns, count)


def _log(event: Event) -> bytes:
    seconds, nanos = divmod(event.time_ns, 1_000_000_000)
    return Log(
        timestamp=Timestamp(seconds=seconds, nanos=nanos),
        level=event.level,  # type: ignore[arg-type]
        message=event.message,
        name=event.name,
    ).SerializeToString()


FORMATS: dict[str, Callable[[Samples, Path], None]] = {
    ".mcap": write_mcap, ".parquet": write_parquet, ".csv": write_csv, ".npz": write_npz,
    ".h5": write_hdf5,
}  # fmt: skip


def outputs(path: Path) -> list[Path]:
    """The files that an export to `path` writes."""
    return [path, columns_file(path)] if path.suffix == ".csv" else [path]


def export(samples: Samples, path: Path) -> None:
    """Write the samples to a file, all or nothing: what exists is replaced by a whole one only.

    Raises RecordingError if the recording cannot be read on or the file not be written.
    """
    try:
        with ExitStack() as files:
            unfinished, *beside = (files.enter_context(whole_file(one)) for one in outputs(path))
            FORMATS[path.suffix](samples, unfinished)
            for one in beside:
                _write_columns(samples, one)
    except NotWritten as error:
        raise RecordingError(str(error)) from error
