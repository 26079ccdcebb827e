"""Read a text table: one header line with names, and rows of numbers.

Example:
    # comment
    time_s;contact_force_n
    0.0;0.013
"""

import io
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv

from hertzloop.common.text_files import text_of
from hertzloop.fitting.records.errors import RecordError

_REMEDY = """Give one header line with names, and below it rows of numbers without empty lines; \
comments stand in lines that begin with '#'. Or read the file in Python, and make a record:
  t_s, values = numpy.loadtxt("{name}", delimiter=",", skiprows=1, unpack=True)
  record = hertzloop.Record("{name}", t_s, values, "contact_force")  # in s and N
  result = hertzloop.fit(scene, record, ["sphere.radius_m"])"""


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
