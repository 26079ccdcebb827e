"""Read the columns of a file: text, Parquet, NPZ, or a recording of hertzloop."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.missing_files import why_unreadable
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.text_table import read_text_table
from hertzloop.sensors.acquisition import Filters

ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".parquet", ".npz", ".mcap")


@dataclass
class FileContents:
    """What a file holds.

    Attributes:
        columns: values by name, each of shape (samples,), in the order of the file.
        facts: keys of the `[record]` table that the file states itself.
        notes: sentences on what is not used.
    """

    columns: dict[str, np.ndarray]
    facts: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_file(path: Path, decimal: str) -> FileContents:
    """Return what a file holds.

    Raises:
        RecordError: there is no such file, or it cannot be read.
    """
    if not path.is_file():
        why = why_unreadable(path, FileNotFoundError(), "Give the path of a record.")
        raise RecordError(f"{path}: cannot be read: {why}")
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise RecordError(
            f"{path}: '{path.suffix}' is not a known format. Give one of {', '.join(ENDINGS)}, or "
            "make a hertzloop.Record of arrays."
        )
    try:
        if suffix == ".parquet":
            return FileContents(_numbers(_read_parquet(path)))
        if suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                return FileContents(_numbers(dict(arrays)))
        if suffix == ".mcap":
            return _read_recording(path)
        return FileContents(read_text_table(path, decimal))
    except RecordError:
        raise
    except Exception as error:  # every library has its own ways to say that a file is damaged
        words = (str(error) or type(error).__name__).splitlines()[0]
        raise RecordError(f"{path}: cannot be read as {suffix[1:]}: {words}.") from error


def _read_parquet(path: Path) -> dict[str, np.ndarray]:
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def _numbers(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays that hold a series of real numbers."""
    return {
        name: np.asarray(values, float)
        for name, values in arrays.items()
        if values.ndim == 1 and values.dtype.kind in "iuf"
    }


def _read_recording(path: Path) -> FileContents:
    """Read the samples of a recording; quantity, law and filters are those of its scene."""
    from hertzloop.recordings.reader import read
    from hertzloop.scene.setup import parse

    found = read(path)
    setup = parse(found.scene_toml, recorded=True)
    daq = found.daq
    if found.problems and not daq.samples:
        raise RecordError(
            f"{path}: the recording is damaged: its first samples are missing. Give a complete "
            "recording."
        )
    step_s = setup.sensor.every_steps * setup.run.step_s
    notes = []
    if found.problems:
        notes.append(
            f"the samples end at {1e3 * daq.samples * step_s:.6g} ms: {found.problems[0]}."
        )
    force = found.force
    pushed = np.any(force.arrays.get("force_n", 0.0))
    facts: dict[str, Any] = {
        "quantity": setup.scene.sensors.quantity,
        "unit": QUANTITIES[setup.scene.sensors.quantity].unit,
        "rate_hz": 1.0 / step_s,
        "control": setup.scene.controller.has_law and bool(pushed),
    }
    if not setup.sensor.ideal:
        names = {one.name for one in fields(Filters)}
        if setup.sensor.low_pass_hz is None:
            names -= {"low_pass", "low_pass_order"}
        if setup.sensor.resonance_hz is None:
            names -= {"resonance_damping"}
        of_sensor = {name: getattr(setup.sensor, name) for name in names}
        facts |= {key: value for key, value in of_sensor.items() if value is not None}
    return FileContents({"value": np.asarray(daq.values, float)}, facts, notes)
