"""Export to an MCAP file that viewers draw: one topic a column, one number a message.

A message is a `std_msgs/msg/Float64MultiArray` of ROS 2 with one value, in CDR. Rerun, Foxglove and
PlotJuggler draw it as a curve without a plug-in. Log time = publish time = simulated time.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from hertzloop.recordings.export.samples import STREAMS, Piece, Samples
from hertzloop.recordings.file_format import (
    EXPORT_LIBRARY,
    LAW_ATTACHMENT,
    RUN_METADATA,
    SCENE_ATTACHMENT,
)
from hertzloop.recordings.recording import Event

SCHEMA = "std_msgs/msg/Float64MultiArray"
# Definition as ROS 2 writes it into a bag: the message, then the types in it.
_DEFINITION = f"""std_msgs/MultiArrayLayout layout
float64[] data
{"=" * 80}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{"=" * 80}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""
# CDR, little-endian: encapsulation, no dimensions, no offset, one value; it begins at a multiple of
# eight bytes after the encapsulation.
_BEFORE_VALUE = np.array([0x0100, 0, 0, 1, 0], "<u4").tobytes()


@dataclass(frozen=True)
class _Topic:
    """A channel and where its values come from."""

    channel: int
    stream: str
    column: str

    def payloads(self, values: np.ndarray) -> list[bytes]:
        """The messages of a piece, serialised all at once: they have one length."""
        before = f"V{len(_BEFORE_VALUE)}"
        packed = np.empty(len(values), [("before", before), ("value", "<f8")])
        packed["before"] = np.frombuffer(_BEFORE_VALUE, before)
        packed["value"] = values
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
            end_ns = samples.step_ns * max(
                int(steps[-1]) for steps, _ in window.values() if len(steps)
            )
            due = [event for event in events if event.time_ns <= end_ns]
            events = events[len(due) :]
            _write_window(writer, samples, window, topics, due, log)
        _write_window(writer, samples, {}, topics, events, log)
        writer.finish()


def _topics(writer: Writer, samples: Samples) -> list[_Topic]:
    schema = writer.register_schema(SCHEMA, "ros2msg", _DEFINITION.encode())
    found = []
    for stream in STREAMS:
        for column in samples.columns[stream]:
            about = dict(zip(("unit", "meaning"), samples.label(column), strict=True))
            channel = writer.register_channel(f"/{stream}/{column}", "cdr", schema, about)
            found.append(_Topic(channel, stream, column))
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
            payloads += topic.payloads(arrays[topic.column])
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
