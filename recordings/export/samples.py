"""Samples of a recording for an export: columns with labels, within a span of time."""

from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.joined_stream import Arrays, JoinedStream
from hertzloop.recordings.recording import Recording

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
        stream = self.stream(name)
        low, high = self.span_ns
        for at, arrays in stream.placed():
            steps = stream.step_at(np.arange(at, at + len(next(iter(arrays.values())))))
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
