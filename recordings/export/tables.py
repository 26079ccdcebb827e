"""Export to tables: Parquet and CSV, with one row a step."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet

from hertzloop.recordings.export.samples import STREAMS, Piece, Samples

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


def write_columns(samples: Samples, path: Path) -> None:
    """Write the file beside a CSV export, see `columns_file`."""
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
        for name, values in samples.columns[stream].items():
            columns.append(column(name, values.dtype, samples.label(name)))
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
        own, arrays = window[stream]
        rows = np.searchsorted(steps, own)
        missing = np.ones(len(steps), bool)
        missing[rows] = False
        for known in arrays.values():
            values = np.zeros(len(steps), known.dtype)
            values[rows] = known
            columns.append(pa.array(values, mask=missing if missing.any() else None))
    return pa.Table.from_arrays(columns, schema=schema)
