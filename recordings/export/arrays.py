"""Export to array files: NPZ and HDF5, with one array a column and stream."""

import json
import zipfile
from collections.abc import Iterator
from io import FileIO, RawIOBase
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.recordings.export.samples import STREAMS, Label, Samples

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
        "descr": np.lib.format.dtype_to_descr(dtype),
        "fortran_order": False,
        "shape": (count,),
    }
    with archive.open(f"{stream}/{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array_header_2_0(entry, header)
        for steps, arrays in samples.pieces(stream):
            values = steps * samples.step_ns if is_time else arrays[name]
            entry.write(np.ascontiguousarray(values, dtype).tobytes())


def write_hdf5(samples: Samples, path: Path) -> None:
    """A group a stream; every dataset has the attributes `units` and `long_name`."""
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
                    f"{stream}/{name}",
                    (0,),
                    dtype,
                    maxshape=(None,),
                    chunks=(1 << 14,),
                    compression="gzip",
                    compression_opts=1,
                    shuffle=True,
                )
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
