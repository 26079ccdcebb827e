"""Recordings of short runs, and copies of them with something changed."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import Event, RunEnd
from hertzloop.bus.streams import STREAMS
from hertzloop.loop import in_process
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.run_options import RunOptions
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingWriter
from hertzloop.scene.setup import Setup, load

# 2.5 ms: the last block is half a block. A coarse model, for speed.
SHORT = ["run.duration_s=0.0025", "run.accuracy=0.1"]


def scene(*settings: str) -> Setup:
    return load("aluminium-3mm", [*SHORT, *settings])


def record(
    path: Path, *settings: str, compiled: bool = False, max_exchange_steps: int | None = None
) -> Path:
    """Record a short run, with a block of truth every 1000 steps."""
    with patch.object(in_process, "EVERY_S", 0.0):
        record_in_process(
            scene(*settings),
            path,
            RunOptions(max_exchange_steps=max_exchange_steps),
            compiled=compiled,
        )
    return path


@dataclass
class Sent:
    """One recorded message: stream, number in its stream, time, header and writable arrays."""

    stream: str
    number: int
    time_ns: int
    header: Any
    arrays: dict[str, np.ndarray]


def messages(path: Path) -> list[Sent]:
    """All messages of a recording in their order."""
    topics: dict[int, str] = {}
    counts: dict[str, int] = {}
    found = []
    with path.open("rb") as file:
        for record in StreamReader(file).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                topic = topics[record.channel_id]
                kind = next(s.message for s in STREAMS.values() if s.topic == topic)
                block = codec.decode(kind, record.data)
                stream = topic[1:]
                if isinstance(block.header, Event):
                    stream = f"events/{block.header.name}"
                elif isinstance(block.header, RunEnd):
                    stream = f"end/{block.header.role}"
                number = counts.get(stream, 0)
                counts[stream] = number + 1
                arrays = {name: a.copy() for name, a in block.arrays.items() if len(a)}
                found.append(Sent(stream, number, record.log_time, block.header, arrays))
    return found


def write(
    path: Path,
    original: Path,
    sent: Iterable[Sent],
    scene_toml: str = "",
    fault: str = "",
    **metadata: str,
) -> Path:
    """A recording like `original` with these messages; its scene, fault and metadata are those that
    are given."""
    source = read(original)
    writer = RecordingWriter(path)
    writer.scene(scene_toml or source.scene_toml, source.metadata | metadata)
    if source.law_source:
        writer.law(source.law_source)
    for item in sent:
        payload = codec.encode(item.header, **item.arrays)
        writer.write(item.stream, payload, item.number, item.time_ns)
    writer.finish(source.result | ({"fault": fault} if fault else {}))
    return path


def rewrite(original: Path, path: Path, change: Callable[[Sent], bool | None]) -> Path:
    """A copy in which `change` altered messages; it returns False for one to be left out."""
    return write(path, original, [m for m in messages(original) if change(m) is not False])
