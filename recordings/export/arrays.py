"""Streams as arrays, each with times of its own: NPZ and HDF5, with units."""

import json
import zipfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from recordings.export.samples import STREAMS, Label, Samples
from recordings.writer import RecordingError

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
    import h5py

    with h5py.File(path, "w") as file:
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
