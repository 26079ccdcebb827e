"""Samples of a recording for an export: columns with labels, within a span of time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.recording import Recording, SampledStream

WINDOW_STEPS = 1 << 16
STREAMS = ("truth", "daq", "force")

Arrays = dict[str, np.ndarray]
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
    def columns(self) -> dict[str, Arrays]:
        """All columns by stream and name."""
        daq, force, truth = self.recording.daq, self.recording.force, self.recording.truth
        names = {"code": "daq_code", "value": "daq_value", "saturated": "daq_saturated"}
        acquired = {new: daq.arrays[old] for old, new in names.items() if old in daq.arrays}
        if "code" in daq.arrays:
            acquired["daq_value"] = daq.values
        commanded = {"command_n": force.arrays["force_n"]} if force.arrays else {}
        return {"truth": dict(truth.arrays), "daq": acquired, "force": commanded}

    def stream(self, name: str) -> SampledStream:
        """One of STREAMS."""
        found = getattr(self.recording, name)
        assert isinstance(found, SampledStream)
        return found

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""
        return max(self.stream(name).step_ns for name in STREAMS) or 1

    @property
    def end_step(self) -> int:
        """Step after the last sample of the recording."""
        streams = map(self.stream, STREAMS)
        return max((s.end_step - s.every_steps + 1 for s in streams if s.samples), default=0)

    def label(self, column: str) -> Label:
        """Unit and meaning of a column; empty words where there are none."""
        return self.labels.get(column, ("", ""))

    def windows(self) -> Iterator[dict[str, Piece]]:
        """Yield samples of all streams side by side: at most WINDOW_STEPS steps at a time."""
        low, high = self.span_ns
        start, stop = -(-low // self.step_ns), min(high // self.step_ns + 1, self.end_step)
        for first in range(start, stop, WINDOW_STEPS):
            end = min(first + WINDOW_STEPS, stop)
            found = {name: self._piece(name, first, end) for name in STREAMS}
            if any(len(steps) for steps, _ in found.values()):
                yield found

    def _piece(self, name: str, first: int, end: int) -> Piece:
        """Return the samples of a stream from step `first` to before `end`."""
        stream = self.stream(name)
        every = stream.every_steps
        a, b = -(-first // every), min(-(-end // every), stream.samples)
        return np.arange(a, max(a, b)) * every, {
            label: values[a:b] for label, values in self.columns[name].items()
        }
