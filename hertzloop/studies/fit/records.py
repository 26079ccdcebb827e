"""Measured records: values over time, with what is known of the measurement.

A record comes from a file. Its `[record]` table is in a TOML file of the same name beside it, or in
lines of a CSV file that begin with `#`.
"""

import codecs
import csv
import hashlib
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class RecordError(ValueError):
    """A record cannot be used. The message names the field, its value and the remedy."""

    exit_status = 2


class Quantity(NamedTuple):
    """A quantity that can be measured: SI unit, meaning, and the `sensors.quantity` of a scene that
    samples it, "" if none does."""

    unit: str
    meaning: str
    sensed: str


QUANTITIES = {
    "contact_force": Quantity("N", "contact force, up on the sphere", "contact_force"),
    "v_p": Quantity("m/s", "plate velocity, up positive", "v_p"),
    "acceleration": Quantity("m/s^2", "plate acceleration, up positive", "acceleration"),
    "actuator_force": Quantity("N", "force of the actuator, up on the plate", ""),
    "xi_p": Quantity("m", "plate displacement, up positive", ""),
    "xi": Quantity("m", "gap between sphere and plate", "xi"),
    "xi_s": Quantity("m", "sphere's lowest point", ""),
}
_ALIASES = {
    "force": "contact_force", "velocity": "v_p", "plate_velocity": "v_p", "accel": "acceleration",
    "plate_acceleration": "acceleration", "displacement": "xi_p", "plate_displacement": "xi_p",
    "gap": "xi", "sphere_position": "xi_s", "f_a": "actuator_force",
}  # fmt: skip
# Factor to the SI unit, by the quantity's SI unit.
UNITS: dict[str, dict[str, float]] = {
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "cm/s": 1e-2, "in/s": 0.0254},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "g": 9.80665, "mm/s^2": 1e-3},
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
}
WITHOUT_CONTROL = "The records are simulated without control: no law, no latency, no force."
FILTERS = ("low_pass_hz", "ac_coupling_hz", "resonance_hz", "resonance_damping")
_FEWEST = 8  # samples of a record
_AT_REST = 0.1  # of the largest value, up to which a sensor is at rest
_PLATEAU = 3  # equal extreme values in a row that count as clipped
_LEVELS = 4096  # distinct values; more than these are no visible converter
_OWN_TIME = " (its times)"  # ends the name of the times of a column that has its own
DEFAULT_GAIN_UNCERTAINTY = 0.03
DEFAULT_CLOCK_PPM = 50.0


@dataclass(frozen=True)
class Measured:
    """The `[record]` table: what is known of a measurement.

    `quantity`, `unit`: what the values are; `column`, `channel`: where they are in the file.
    `sensitivity`: units of the file for one unit of `unit`, e.g. V for N (1 if left out), and
    `sensitivity_uncertainty`, relative standard deviation. `rate_hz`: where the file has no times.
    `clock_tolerance_ppm`: standard deviation of the clock's relative error. `low_pass_hz`,
    `ac_coupling_hz`, `resonance_hz`, `resonance_damping`: filters of the measuring chain.
    `range`, `bits`: of the converter, in `unit`. `point_m`: measuring point, m. `set`: scene keys
    that hold for this record only, such as its drop height. `control`: whether the law was on; if
    left out, it was where the force of the actuator is the quantity or has a free key. `clock`: a
    name that channels of one drop share which were sampled by one clock.
    """

    quantity: str | None = None
    unit: str | None = None
    column: str | None = None
    sensitivity: float = 1.0
    sensitivity_uncertainty: float = DEFAULT_GAIN_UNCERTAINTY
    rate_hz: float | None = None
    clock_tolerance_ppm: float = DEFAULT_CLOCK_PPM
    low_pass_hz: float | None = None
    ac_coupling_hz: float | None = None
    resonance_hz: float | None = None
    resonance_damping: float = 0.02
    range: tuple[float, float] | None = None
    bits: int | None = None
    point_m: tuple[float, float] | None = None
    set: Mapping[str, Any] = field(default_factory=dict)
    control: bool | None = None
    clock: str | None = None

    @property
    def filtered(self) -> bool:
        """Whether the table names a filter."""
        return any(f is not None for f in (self.low_pass_hz, self.ac_coupling_hz,
                                           self.resonance_hz))  # fmt: skip


@dataclass(frozen=True)
class Record:
    """A measured record.

    Args:
        name: name in messages.
        time_s: times by the record's clock, s, shape (samples,), rising; the zero is arbitrary.
        value: in the SI unit of the quantity, shape (samples,); nan where nothing is known.
        quantity: "contact_force", "actuator_force" (N), "v_p" (m/s), "acceleration" (m/s^2),
            "xi_p", "xi" or "xi_s" (m).
        measured: the `[record]` table: filters, range, uncertainties.
        sha256: digest of the file, "" of a record from memory.

    Raises:
        RecordError: the arrays cannot be a record.
    """

    name: str
    time_s: np.ndarray
    value: np.ndarray
    quantity: str
    measured: Measured = field(default_factory=Measured)
    sha256: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise RecordError(
                f"record.quantity = '{self.quantity}': not known in {self.name}. Give one of "
                f"{', '.join(QUANTITIES)}."
            )
        if len(self.time_s) != len(self.value) or np.ndim(self.value) != 1:
            raise RecordError(
                f"{self.name}: has {len(self.time_s)} times and values of shape "
                f"{np.shape(self.value)}. Give one value for each time."
            )
        if len(self.value) == 0:
            raise RecordError(f"{self.name}: has no samples. Give a record of one impact.")
        if len(self.value) < _FEWEST:
            raise RecordError(
                f"{self.name}: has {len(self.value)} samples. Give at least {_FEWEST}, with some "
                "before the impact."
            )
        wrong = np.flatnonzero(~(np.diff(self.time_s) > 0.0))
        if len(wrong):
            at = int(wrong[0])
            raise RecordError(
                f"{self.name}: its times do not rise from sample to sample: sample {at + 2} at "
                f"{self.time_s[at + 1]:.9g} s follows sample {at + 1} at {self.time_s[at]:.9g} s. "
                "Give one impact in the order of time, and write times with enough digits. Or "
                "leave time_s out and give record.rate_hz."
            )

    @property
    def interval_s(self) -> float:
        """Median time between two samples, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def uniform(self) -> bool:
        """Whether samples have one distance, to a hundredth of it."""
        steps = np.diff(self.time_s)
        return bool(np.max(np.abs(steps - self.interval_s)) < 1e-2 * self.interval_s)


def clipped(record: Record) -> np.ndarray:
    """Return which samples are at the end of the range, shape (samples,), bool.

    These are samples outside the range of the table, or three and more equal extremes in a row far
    from the usual value.
    """
    value = record.value
    found = np.zeros(len(value), bool)
    if record.measured.range is not None:
        factor = _factor(record.quantity, record.measured)
        low, high = (factor * end for end in record.measured.range)
        margin = 1e-6 * (high - low)
        found |= (value <= low + margin) | (value >= high - margin)
        # A sensor that rests at the end of its range is not clipped there.
        if np.mean(found) > 0.5:
            found[:] = False
    usual = float(np.nanmedian(value))
    largest = float(np.nanmax(np.abs(value - usual)))
    if largest == 0.0:
        return found
    # A long contact may take most of the record; then the usual value is not that at rest.
    rest = 0.0 if record.quantity in ("xi", "xi_s") else _AT_REST * float(np.nanmax(np.abs(value)))
    for extreme in (np.nanmin(value), np.nanmax(value)):
        if abs(extreme - usual) < 0.3 * largest or abs(extreme) < rest:
            continue
        same = value == extreme
        starts = np.flatnonzero(np.diff(np.concatenate([[False], same]).astype(int)) == 1)
        for start in starts:
            end = start
            while end < len(value) and same[end]:
                end += 1
            if end - start >= _PLATEAU:
                found[start:end] = True
    return found


def converter_step(record: Record) -> float:
    """Distance of two levels of the converter, in SI units; zero if none is visible."""
    if record.measured.bits and record.measured.range:
        low, high = record.measured.range
        return (
            _factor(record.quantity, record.measured) * (high - low) / (2**record.measured.bits - 1)
        )
    known = record.value[np.isfinite(record.value)]
    levels = np.unique(known)
    if not 2 <= len(levels) <= min(_LEVELS, len(known) // 2):
        return 0.0
    steps = np.diff(levels)
    step = float(np.min(steps))
    if step <= 1e-9 * (levels[-1] - levels[0]):
        return 0.0
    turns = steps / step
    return step if bool(np.all(np.abs(turns - np.round(turns)) < 0.05)) else 0.0


def read_record(path: Path, given: Mapping[str, Any] | None = None) -> Record:
    """Read a record.

    Args:
        path: CSV, Parquet, NPZ, HDF5, WAV, MCAP, TDMS, UFF or MDF.
        given: keys of the `[record]` table that replace those of the file.

    Raises:
        RecordError: the file is not a record, or its table is wrong.
        ModuleNotFoundError: the format needs a package of an extra.
    """
    if not path.is_file():
        raise RecordError(f"{path}: there is no such file. Give the path of a record.")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise RecordError(
            f"{path}: '{path.suffix}' is not a known format. Give one of "
            f"{', '.join(sorted(_READERS))}."
        )
    try:
        content = path.read_bytes() if path.stat().st_size < 1 << 30 else b""
        columns, inside = reader(path)
    except RecordError:
        raise
    except ModuleNotFoundError:
        raise
    except Exception as error:  # every library has its own ways to say that a file is damaged
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: cannot be read as {path.suffix[1:]}: {words}.") from error
    beside = path.with_suffix(".toml")
    table = dict(inside)
    if beside.is_file():
        try:
            table |= tomllib.loads(beside.read_text("utf-8")).get("record", {})
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise RecordError(f"{beside}: is not valid TOML: {error}.") from error
    table |= dict(given or {})
    digest = hashlib.sha256(content).hexdigest() if content else ""
    return _made(path.name, columns, measured_of(table, path.name), digest)


def measured_of(table: Mapping[str, Any], name: str) -> Measured:
    """Return a `[record]` table as an object. Raises RecordError for a wrong key or value."""
    known = {part.name for part in fields(Measured)}
    for key in table:
        if key not in known:
            raise RecordError(
                f"record.{key}: not a key of the record table of {name}. Known keys: "
                f"{', '.join(sorted(known))}."
            )
    values = dict(table)
    for key in ("range", "point_m"):
        if key in values:
            try:
                low, high = (float(x) for x in values[key])
            except (TypeError, ValueError) as error:
                raise RecordError(f"record.{key} = {values[key]}: must be two numbers.") from error
            values[key] = (low, high)
    numbers = ("sensitivity", "sensitivity_uncertainty", "rate_hz", "clock_tolerance_ppm",
               "low_pass_hz", "ac_coupling_hz", "resonance_hz", "resonance_damping")  # fmt: skip
    for key in numbers:
        if key not in values:
            continue
        value = values[key]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        least_ok = key in ("sensitivity_uncertainty", "clock_tolerance_ppm")
        good = number and math.isfinite(value) and (value >= 0 if least_ok else value != 0)
        if not good or (key != "sensitivity" and value < 0):
            raise RecordError(f"record.{key} = {value}: must be a positive number in {name}.")
    for key, kind, what in (("control", bool, "true or false"), ("clock", str, "a name")):
        if key in values and not isinstance(values[key], kind):
            raise RecordError(f"record.{key} = {values[key]}: must be {what} in {name}.")
    return Measured(**values)


def _factor(quantity: str, measured: Measured) -> float:
    """SI value of one of the file's units."""
    units = UNITS[QUANTITIES[quantity].unit]
    unit = measured.unit or QUANTITIES[quantity].unit
    if unit not in units:
        raise RecordError(
            f"record.unit = '{unit}': not a unit of {quantity}. Give one of {', '.join(units)}."
        )
    return units[unit] / measured.sensitivity


def quantity_of(column: str) -> tuple[str, str | None] | None:
    """Return quantity and unit of a column by its name, such as `v_p_mm_s`; None if unknown."""
    name = _plain(column)
    names = {**{q: q for q in QUANTITIES}, **_ALIASES}
    for start in sorted(names, key=len, reverse=True):
        if name == start:
            return names[start], None
        if name.startswith(start + "_"):
            quantity = names[start]
            rest = name[len(start) + 1 :]
            for unit in UNITS[QUANTITIES[quantity].unit]:
                if rest == unit.lower().replace("/", "_").replace("^", ""):
                    return quantity, unit
    return None


_SECONDS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
    "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nsec": 1e-9,
    "nanoseconds": 1e-9, "min": 60.0, "minutes": 60.0,
}  # fmt: skip


def _plain(column: str) -> str:
    """A column name as in `contact_force_n`: "Force [N]" is force_n, "Time (ms)" is time_ms."""
    name = column.strip().lower().replace("^", "").replace("\u00b2", "2")
    return re.sub(r"[^a-z0-9]+", "_", re.sub("[\u00b5\u03bc]", "u", name)).strip("_")


def _unit_of_time(column: str) -> float | None:
    """Seconds in the unit of a column of times, such as `time_ms`; None of another column."""
    found = re.fullmatch(r"(?:time|t|timestamp|datetime)(?:_(\w+))?", _plain(column))
    return None if found is None else _SECONDS.get(found[1] or "")


def _with_unit(column: str, unit: Any) -> str:
    """The name of a column with a unit that stands beside it, if the name says none: "Time" in "us"
    is "Time (us)". A unit that the record could not have is left out."""
    named = f"{column} ({str(unit).strip(' ()[]')})"
    if _unit_of_time(column) == 1.0 and _unit_of_time(named) is not None:
        return named
    said, more = quantity_of(column), quantity_of(named)
    return named if said and more and said[1] is None else column


def _numbers(values: Any) -> np.ndarray:
    """Values of a file as numbers: durations in seconds, and timestamps from the first one on."""
    found = np.asarray(values)
    if found.dtype.kind == "O":  # dates or durations of another library
        with suppress(ValueError, TypeError):
            kind = "M8[ns]" if hasattr(found.flat[0], "year") else "m8[ns]"
            found = found.astype(kind)
    if found.dtype.kind == "M":
        found = found - found[~np.isnat(found)][0] if not np.all(np.isnat(found)) else found
    if found.dtype.kind in "mM":
        known = ~np.isnat(found)
        fine = found.astype("m8[ns]").astype(np.int64)
        return np.where(known, 1e-9 * fine, np.nan)
    return np.asarray(found, float)


def _made(name: str, columns: Mapping[str, np.ndarray], measured: Measured, digest: str) -> Record:
    if not columns or all(len(column) == 0 for column in columns.values()):
        raise RecordError(f"{name}: has no samples. Give a record of one impact.")
    time_name = next((c for c in columns if _unit_of_time(c)), None)
    others = [c for c in columns if c != time_name and not c.endswith(_OWN_TIME)]
    column = measured.column
    notes = []
    if column is None:
        known_columns = [c for c in others if quantity_of(c)]
        column = next(iter(known_columns), None)
        if len(known_columns) > 1:
            notes.append(
                f"{name}: column {column} is used, and {', '.join(known_columns[1:])} is not. "
                "Choose with record.column."
            )
        if column is None and measured.quantity and others:
            column = others[0]
    if column is not None and column not in columns:  # a unit may stand behind it by now
        column = next((c for c in others if c.rpartition(" (")[0] == column), column)
    if column is None or column not in columns:
        raise RecordError(
            (f"record.column = '{column}': not a column of {name}. " if column else "")
            + f"{name}: no column is a known quantity; the columns are {', '.join(columns)}. Name "
            "a column such as contact_force_n or v_p_m_s, or give record.quantity and "
            "record.column."
        )
    said = quantity_of(column)
    quantity = measured.quantity or (said[0] if said else None)
    quantity = _ALIASES.get(quantity or "", quantity)
    if quantity not in QUANTITIES:
        raise RecordError(
            f"record.quantity = '{quantity}': not known in {name}. Give one of "
            f"{', '.join(QUANTITIES)}."
        )
    if measured.unit is None and said and said[0] == quantity and said[1]:
        measured = replace(measured, unit=said[1])
    value = np.asarray(columns[column], float)
    own_time = columns.get(column + _OWN_TIME)
    if own_time is not None:
        time_s = np.asarray(own_time, float)
    elif time_name is not None:
        time_s = np.asarray(columns[time_name], float) * (_unit_of_time(time_name) or 1.0)
    elif measured.rate_hz:
        time_s = np.arange(len(value)) / measured.rate_hz
    else:
        raise RecordError(
            f"{name}: has no column time_s; the columns are {', '.join(columns)}. Add one, or give "
            "record.rate_hz in samples per second."
        )
    known = np.isfinite(time_s)
    if not np.any(known):
        raise RecordError(
            f"{name}: no time is a number. Write numbers with a decimal point, in seconds."
        )
    if not np.all(known):
        notes.append(f"{name}: {np.count_nonzero(~known)} samples have no time and are not used.")
        time_s, value = time_s[known], value[known]
    gone = ~np.isfinite(value)
    if np.any(gone):
        if np.count_nonzero(~gone) < _FEWEST or np.mean(gone) > 0.5:
            raise RecordError(
                f"{name}: {np.count_nonzero(gone)} of {len(value)} samples are not numbers. Give a "
                "record without gaps."
            )
        notes.append(f"{name}: {np.count_nonzero(gone)} samples are not numbers and are not used.")
    measured = replace(measured, quantity=quantity)
    value = value * _factor(quantity, measured)
    return Record(name, time_s, value, quantity, measured, digest, tuple(notes))


# Readers: columns by name, and the `[record]` table in the file.

_Read = tuple[dict[str, np.ndarray], dict[str, Any]]


def _csv(path: Path) -> _Read:
    table_lines: list[str] = []
    with path.open(encoding=_encoding(path), newline="") as file:
        line = file.readline()
        while line.startswith("#"):
            table_lines.append(line[1:].strip())
            line = file.readline()
        position = file.tell()
        first, between = file.readline(), []
        while first and not re.match(r"\s*\"?[+-]?[.,]?(\d|nan|inf)", first.strip().lower()):
            between.append(first)  # a row of units, or an empty one
            position, first = file.tell(), file.readline()
        if not line.strip() or not first:
            return {}, {}
        # Programs of some languages write semicolons, tabs or spaces, and decimal commas.
        delimiter = next((d for d in ";\t," if d in line), None)
        header = next(csv.reader([line], delimiter=delimiter)) if delimiter else [line.strip()]
        if delimiter is None and len(first.split()) == len(line.split()):
            header = line.split()
        if _is_number(header[0]):
            raise RecordError(
                f"{path}: the first line holds numbers. Give a first line with a name for each "
                "column, such as time_s,contact_force_n."
            )
        for line in between:
            units = next(csv.reader([line], delimiter=delimiter)) if delimiter else line.split()
            if len(units) == len(header):
                header = [_with_unit(*pair) for pair in zip(header, units, strict=True)]
        comma = delimiter != "," and "," in first and "." not in first
        other = {ord('"'): ""} if '"' in first else {}
        if comma:
            other[ord(",")] = "."

        def rows() -> Iterator[str]:
            file.seek(position)
            return (text.translate(other) for text in file) if other else iter(file)

        try:
            table = np.loadtxt(rows(), delimiter=delimiter, ndmin=2)
        except ValueError:  # a text or nothing in place of a number
            try:
                lines = (text for text in rows() if text.strip())
                table = np.genfromtxt(lines, delimiter=delimiter, dtype=float, ndmin=2)
            except ValueError as error:
                raise RecordError(
                    f"{path}: not all rows have {len(header)} columns as the first line has. Write "
                    "the file again; it may be cut off."
                ) from error
    if table.shape[1] != len(header):
        raise RecordError(
            f"{path}: the first line names {len(header)} columns and the rows have "
            f"{table.shape[1]}. Give a name for each column, and separate the columns by "
            "semicolons if numbers have decimal commas."
        )
    return (
        {name.strip(): table[:, i] for i, name in enumerate(header)},
        _inner_table("\n".join(table_lines)),
    )


def _encoding(path: Path) -> str:
    """The encoding of a text file: UTF-16 with its mark, UTF-8, or else that of Windows."""
    with path.open("rb") as file:
        start = file.read(1 << 16)
    if start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _inner_table(text: str) -> dict[str, Any]:
    """The `[record]` table of comment lines; other comments mean nothing."""
    if "[record]" not in text:
        return {}
    try:
        found: dict[str, Any] = tomllib.loads(text[text.index("[record]") :]).get("record", {})
    except tomllib.TOMLDecodeError as error:
        raise RecordError(
            f"the record table in the comments is not valid TOML: {error}."
        ) from error
    return found


def _json_table(value: Any) -> dict[str, Any]:
    """A `[record]` table that a format keeps as TOML text."""
    if isinstance(value, bytes):
        value = value.decode("utf-8")
    return _inner_table(str(value))


def _parquet(path: Path) -> _Read:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    inside = (table.schema.metadata or {}).get(b"record", b"")
    found = {}
    for name in table.column_names:
        values, kind = table[name], table.schema.field(name).type
        if pyarrow.types.is_time(kind):  # of day
            values = np.asarray(values.cast(f"int{kind.bit_width}")).astype(f"m8[{kind.unit}]")
        found[name] = _numbers(values)
    return found, _json_table(inside)


def _npz(path: Path) -> _Read:
    with np.load(path, allow_pickle=False) as data:
        found = {name: data[name] for name in data.files}
    inside = found.pop("record", "")
    return {n: _numbers(v) for n, v in found.items() if np.ndim(v) == 1}, _json_table(inside)


def _hdf5(path: Path) -> _Read:
    import h5py

    found: dict[str, np.ndarray] = {}
    with h5py.File(path) as file:

        def keep(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.ndim == 1:
                units = item.attrs.get("units", item.attrs.get("unit", ""))
                found[_with_unit(name.rpartition("/")[2], units)] = _numbers(item)

        file.visititems(keep)
        inside = file.attrs.get("record", "")
    return found, _json_table(inside)


def _wav(path: Path) -> _Read:
    import scipy.io.wavfile

    rate, data = scipy.io.wavfile.read(path)
    values = np.asarray(data, float)
    if values.ndim > 1:
        values = values[:, 0]
    if np.issubdtype(data.dtype, np.integer):
        values = values / float(np.iinfo(data.dtype).max)
    return {"time_s": np.arange(len(values)) / rate, "value": values}, {}


def _mcap(path: Path) -> _Read:
    from hertzloop.recordings.reader import read
    from hertzloop.setup import parse

    found = read(path)
    setup = parse(found.scene_toml, recorded=True)
    values = np.asarray(found.daq_values, float)
    sampled_s = np.arange(len(values)) * setup.every_steps * setup.step_s
    pushed = bool(np.any(found.force.arrays.get("force_n", 0.0)))
    inside: dict[str, Any] = {"quantity": setup.quantity, "column": "value"}
    inside["control"] = setup.has_law and pushed
    of_sensor = {key: getattr(setup.sensor, key) for key in FILTERS}
    if any(of_sensor[key] for key in FILTERS if key.endswith("_hz")):
        inside |= {key: value for key, value in of_sensor.items() if value is not None}
    return {"time_s": sampled_s, "value": values}, inside


def _tdms(path: Path) -> _Read:
    from nptdms import TdmsFile

    found: dict[str, np.ndarray] = {}
    for group in TdmsFile.read(path).groups():
        for channel in group.channels():
            name = _with_unit(channel.name, channel.properties.get("unit_string", ""))
            found[name] = _numbers(channel[:])
            if "wf_increment" in channel.properties:
                # Channels may start at different times.
                found[name + _OWN_TIME] = np.asarray(channel.time_track(), float)
    return found, {}


def _uff(path: Path) -> _Read:
    import pyuff

    found: dict[str, np.ndarray] = {}
    sets = pyuff.UFF(str(path)).read_sets()
    for i, data in enumerate(sets if isinstance(sets, list) else [sets]):
        if data.get("type") == 58:
            name = str(data.get("id1") or f"channel_{i}").strip()
            found[name] = np.real(np.asarray(data["data"]))
            found[name + _OWN_TIME] = np.asarray(data["x"], float)
    return found, {}


def _mdf(path: Path) -> _Read:
    from asammdf import MDF

    found: dict[str, np.ndarray] = {}
    with MDF(path) as file:
        for signal in file.iter_channels():
            if np.ndim(signal.samples) == 1 and len(signal.samples):
                name = _with_unit(signal.name, signal.unit)
                found[name] = np.asarray(signal.samples, float)
                found[name + _OWN_TIME] = np.asarray(signal.timestamps, float)
    return found, {}


_READERS: dict[str, Callable[[Path], _Read]] = {
    ".csv": _csv, ".txt": _csv, ".parquet": _parquet, ".npz": _npz, ".h5": _hdf5, ".hdf5": _hdf5,
    ".wav": _wav, ".mcap": _mcap, ".tdms": _tdms, ".uff": _uff, ".unv": _uff, ".mf4": _mdf,
    ".mdf": _mdf,
}  # fmt: skip
