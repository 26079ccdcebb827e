"""A recorded stream of samples: arrays by field name, and the time of each sample.

Samples stay in the file. They are read whenever somebody asks for them, so a long recording needs
no more memory than what is looked at.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from weakref import WeakValueDictionary

import numpy as np

Arrays = dict[str, np.ndarray]
PIECE = 1 << 16  # samples


class Columns(Mapping[str, np.ndarray]):
    """Arrays by field name, each read when it is asked for and kept while somebody uses it.

    Getting an item raises RecordingError if the file was changed.

    Args:
        read_blocks: Reads the blocks of the stream once more.
        dtypes: Types by field name.
        samples: Length of each array.
    """

    def __init__(
        self, read_blocks: Callable[[], Iterator[Arrays]], dtypes: dict[str, np.dtype], samples: int
    ) -> None:
        self.read_blocks, self.samples, self.dtypes = read_blocks, samples, dtypes
        self._used: WeakValueDictionary[str, np.ndarray] = WeakValueDictionary()

    def __getitem__(self, name: str) -> np.ndarray:
        found = self._used.get(name)
        if found is None:
            found = np.empty(self.samples, self.dtypes[name])
            at = 0
            for arrays in self.read_blocks():
                found[at : at + len(arrays[name])] = arrays[name]
                at += len(arrays[name])
            self._used[name] = found
        return found

    def __contains__(self, name: object) -> bool:
        return name in self.dtypes  # reads no column

    def __iter__(self) -> Iterator[str]:
        return iter(self.dtypes)

    def __len__(self) -> int:
        return len(self.dtypes)


@dataclass
class JoinedStream:
    """One stream joined over its blocks.

    Attributes:
        messages: Number of blocks.
        first_step: Step of the first sample.
        step_ns: Length of a step, ns.
        every_steps: Steps from one sample to the next.
        scale: Unit of the quantity per code of the converter.
        offset: Quantity at code 0.
        arrays: Arrays by field name, each of shape (samples,).
        resumed: Position of the first sample after each gap, and its step.
    """

    messages: int = 0
    first_step: int = 0
    step_ns: int = 0
    every_steps: int = 1
    scale: float = 1.0
    offset: float = 0.0
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    resumed: list[tuple[int, int]] = field(default_factory=list)

    @property
    def samples(self) -> int:
        """Number of samples."""
        if isinstance(self.arrays, Columns):
            return self.arrays.samples
        return max((len(a) for a in self.arrays.values()), default=0)

    def step_at(self, positions: np.ndarray | int) -> np.ndarray:
        """Return the step of the samples at these positions."""
        steps = self.first_step + self.every_steps * np.asarray(positions, dtype=np.int64)
        for position, step in self.resumed:
            later = step + self.every_steps * (np.asarray(positions, dtype=np.int64) - position)
            steps = np.where(np.asarray(positions) >= position, later, steps)
        return np.asarray(steps)

    def time_ns_at(self, position: int) -> int:
        """Return the simulated time of the sample at a position, ns."""
        return int(self.step_at(position)) * self.step_ns

    @property
    def time_ns(self) -> np.ndarray:
        """Simulated time of every sample, shape (samples,), ns."""
        return self.step_at(np.arange(self.samples)) * self.step_ns

    def values_of(self, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return acquired values in the unit of the quantity, shape (samples,).

        They come from the codes of a converter if there are any; empty without values.
        """
        codes = arrays.get("code")
        if codes is not None and len(codes):
            return np.asarray(self.offset + self.scale * codes)
        return arrays.get("value", np.empty(0))

    def before_gap(self) -> "JoinedStream":
        """Return the stream up to the first gap."""
        return self._until(self.resumed[0][0]) if self.resumed else self

    def from_start(self) -> "JoinedStream":
        """Return the stream from step 0 up to the first gap; it is empty if step 0 is missing."""
        return self._until(0) if self.first_step else self.before_gap()

    def _until(self, end: int) -> "JoinedStream":
        """Return the stream up to a position that is not behind its first gap."""

        def read_blocks() -> Iterator[Arrays]:
            left = end
            for arrays in self.blocks():
                if left <= 0:
                    return
                yield {name: values[:left] for name, values in arrays.items()}
                left -= len(next(iter(arrays.values())))

        dtypes = getattr(self.arrays, "dtypes", {})
        return replace(self, arrays=Columns(read_blocks, dtypes, end), resumed=[])

    def blocks(self) -> Iterator[Arrays]:
        """Yield the arrays block by block. Raises RecordingError if the file was changed."""
        if isinstance(self.arrays, Columns):
            yield from self.arrays.read_blocks()
        elif self.arrays:
            yield dict(self.arrays)

    def placed(self) -> Iterator[tuple[int, Arrays]]:
        """Yield blocks as `blocks` does, each with the position of its first sample."""
        at = 0
        for arrays in self.blocks():
            yield at, arrays
            at += len(next(iter(arrays.values())))

    def pieces(self) -> Iterator[tuple[int, Arrays]]:
        """Yield blocks joined to at least PIECE samples, for callers with a cost per block.

        Each comes with the position of its first sample; the last one may be shorter. Raises
        RecordingError if the file was changed.
        """
        at, count, waiting = 0, 0, list[Arrays]()
        for arrays in self.blocks():
            waiting.append(arrays)
            count += len(next(iter(arrays.values())))
            if count >= PIECE:
                yield at, _joined(waiting)
                at, count, waiting = at + count, 0, []
        if waiting:
            yield at, _joined(waiting)


def _joined(blocks: list[Arrays]) -> Arrays:
    if len(blocks) == 1:
        return blocks[0]
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
