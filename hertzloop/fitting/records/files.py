"""Read the columns of a file: text, Parquet, NPZ, or a recording of hertzloop.

Example of a text table:
    # comment
    time_s;contact_force_n
    0.0;0.013
"""

import io
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.csv

from hertzloop.common.missing_files import why_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.sensors.acquisition import Filters

_REMEDY = """Give one header line with names, and below it rows of numbers without empty lines; \
comments stand in lines that begin with '#'. Or read the file in Python, and make a record:
  t_s, values = numpy.loadtxt("{name}", delimiter=",", skiprows=1, unpack=True)
  record = hertzloop.Record("{name}", t_s, values, "contact_force")  # in s and N
  result = hertzloop.fit(scene, record, ["sphere.radius_m"])"""
ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".parquet", ".npz", ".mcap")


def read_text_table(path: Path, decimal: str) -> dict[str, np.ndarray]:
    """Return the columns of a text table by their names; empty cells are nan.

    Args:
        path: a file with columns apart by semicolons, tabs, commas or spaces.
        decimal: decimal sign, "." or ",".

    Raises:
        RecordError: the file is not such a table.
    """
    try:
        lines = text_of(path.read_bytes()).rstrip().split("\n")
    except ValueError as error:
        raise RecordError(f"{path}: {error}.") from error
    if any(line.startswith("#") and "[record]" in line for line in lines):
        raise RecordError(
            f"{path}: has a [record] table in its comments. Write the table to "
            f"{path.with_suffix('.toml').name}."
        )
    lines = [line for line in lines if not line.startswith("#")]
    if len(lines) < 2 or "" in map(str.strip, lines):
        raise _refusal(path, "has no rows, or an empty line between its rows")
    signs = ";\t" if decimal == "," else ";\t,"
    delimiter = next((sign for sign in signs if sign in lines[0]), " ")
    if delimiter == " ":
        lines = [" ".join(line.split()) for line in lines]
    names = [name.strip().strip('"') for name in lines[0].split(delimiter)]
    if len(set(names)) < len(names) or any(map(_is_number, names)):
        raise _refusal(path, f"its first line, '{lines[0][:60]}', does not name its columns")
    rows = io.BytesIO("\n".join(lines[1:]).encode())
    try:
        table = pyarrow.csv.read_csv(
            rows,
            pyarrow.csv.ReadOptions(column_names=names),
            pyarrow.csv.ParseOptions(delimiter=delimiter),
            pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(names, pyarrow.float64()), decimal_point=decimal
            ),
        )
    except pyarrow.ArrowInvalid as error:
        what = str(error).splitlines()[0]
        if decimal == "." and any("," in line for line in lines[1:]) and delimiter != ",":
            what += ". If the comma is a decimal sign, give record.decimal = ','; a comma between "
            what += "thousands has to be removed"
        raise _refusal(path, what) from error
    return {name: table[name].to_numpy() for name in names}


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _refusal(path: Path, why: str) -> RecordError:
    return RecordError(f"{path}: {why}. {_REMEDY.format(name=path.name)}")


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
