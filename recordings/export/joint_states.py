"""Export to an MCAP file with one message a sample.

The schema is `foxglove.JointState`, which Foxglove documents: position (m), velocity (m/s),
acceleration (m/s^2) and effort (N), each only where there is one. A topic is a body or a signal;
log time = publish time = simulated time.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from hertzloop.recordings.export.samples import Piece, Samples
from hertzloop.recordings.file_format import (
    EXPORT_LIBRARY,
    LAW_ATTACHMENT,
    RUN_METADATA,
    SCENE_ATTACHMENT,
)
from hertzloop.recordings.recording import Event

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
