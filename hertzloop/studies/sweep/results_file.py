"""The file of a sweep's results: Parquet, or CSV with a JSON file beside it."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from hertzloop.common.atomic_files import atomic_write, whole_file
from hertzloop.common.missing_files import why_unreadable
from hertzloop.results.cases import CASE_FACTS
from hertzloop.scene.toml import toml_text, toml_value
from hertzloop.studies.cases.design import keys_of


def write_results(out: Path, rows: list[dict[str, Any]], header: dict[str, Any]) -> None:
    """Write a Parquet file with `header` in its metadata, or a CSV file with `header` beside it in
    NAME.csv.json. Raises NotWritten."""
    keys = keys_of(header["design"])
    alike = _one_type_a_column(rows, keys, out.suffix)
    table = pa.table({name: column_of([row[name] for row in alike]) for name in alike[0]})
    about = json.dumps(header, indent=2)
    with whole_file(out) as unfinished:
        if out.suffix == ".parquet":
            kept = {b"hertzloop": about.encode(), **(table.schema.metadata or {})}
            pyarrow.parquet.write_table(table.replace_schema_metadata(kept), unfinished)
        else:
            pyarrow.csv.write_csv(table, unfinished)
            atomic_write(_beside(out), about + "\n")


_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}


def column_of(values: list[Any]) -> pa.Array:
    """Return a column of a table. Numbers and texts are passed as buffers, since `pa.array` imports
    pandas if it is installed, which takes longer than a hundred cases."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return pa.nulls(len(values))
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is str:
        builder = pa.lib.StringBuilder()
        builder.append_values(values)
        return builder.finish()
    if kind not in _TYPES:
        return pa.array(values)
    known = np.array([value is not None for value in values])
    data = np.array([kind() if value is None else value for value in values])
    memory = [
        np.packbits(part, bitorder="little") if part.dtype == bool else part
        for part in (known, data)
    ]
    return pa.Array.from_buffers(_TYPES[kind], len(values), [pa.py_buffer(m) for m in memory])


def _beside(out: Path) -> Path:
    """Return the file with the header of results in CSV."""
    return out.with_name(out.name + ".json")


def _one_type_a_column(
    rows: list[dict[str, Any]], keys: list[str], suffix: str
) -> list[dict[str, Any]]:
    """Return rows with numbers of one type in a column. Keys that have values of several types, or
    lists in CSV, become TOML text."""
    for key in keys:
        if {type(row[key]) for row in rows} == {int, float}:
            rows = [row | {key: float(row[key])} for row in rows]
    text = [
        key
        for key in keys
        if len({type(row[key]) for row in rows}) > 1
        or (suffix != ".parquet" and isinstance(rows[0][key], list))
    ]
    if not text:
        return rows
    return [
        row | {key: None if row[key] is None else toml_text(row[key]) for key in text}
        for row in rows
    ]


def read_results(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return rows and header of a file of results. Raises ValueError for another kind of file."""
    if path.suffix == ".partial":
        raise ValueError(f"{path}: is unfinished. Run the command that started it again.")
    if not os.path.isfile(path):
        why = why_unreadable(path, FileNotFoundError(), "Give a file that a sweep wrote.")
        raise ValueError(f"{path}: cannot be read: {why}")
    if path.suffix == ".csv" and not _beside(path).is_file():
        raise ValueError(f"{path}: the file {_beside(path).name} is missing beside it. Restore it.")
    if path.suffix not in (".parquet", ".csv"):
        raise ValueError(f"{path} holds no results of a sweep, which end in .parquet or .csv")
    try:
        if path.suffix == ".parquet":
            table = pyarrow.parquet.read_table(path)
            header = json.loads(table.schema.metadata[b"hertzloop"])
        else:
            table = pyarrow.csv.read_csv(path)
            header = json.loads(_beside(path).read_text(encoding="utf-8"))
        keys = keys_of(header["design"])
        needed = ["case", *keys, "status", "state"]
        names = dict.fromkeys([*needed, *CASE_FACTS, "growth_per_s"])
        if not {*CASE_FACTS} & {*table.column_names}:
            raise KeyError("column of metrics")
        # An earlier version may lack a metric.
        later = {*CASE_FACTS} - {*table.column_names}
        columns = [name for name in names if name in table.column_names or name in needed]
        rows = [dict.fromkeys(later) | row for row in table.select(columns).to_pylist()]
        for name in ("scene_toml", "span", "versions"):
            header[name]
    except KeyError as error:
        raise ValueError(f"{path} holds no results of a sweep: it has no {error}") from error
    except (pa.ArrowException, ValueError, TypeError, OSError) as error:
        raise ValueError(f"{path} holds no results of a sweep: {error}") from error
    for key in keys:
        for row in rows:
            if isinstance(row[key], str):
                # pyrefly: ignore[bad-argument-type]
                row[key] = toml_value(row[key]) if row[key] else None
    return rows, header
