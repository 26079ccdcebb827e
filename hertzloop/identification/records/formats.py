"""Formats of measured records: what each file holds, as series with names, units and times.

A reader chooses nothing and converts no unit of a value: `records.py` does. Numbers in text are
read by `hertzloop.identification.records.text_tables`, all other formats by their libraries.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hertzloop.identification.records.text_tables import (
    SAMPLE_NUMBERS,
    TableError,
    TextColumn,
    TextTable,
    decoded,
    is_time,
    read_table,
    read_text,
    spacing_s,
    stated,
    stated_unit,
)
from hertzloop.identification.records.units import StatedUnit, name_and_unit, plain_name, unit_of
from hertzloop.sensors.acquisition import Filters


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
    "contact_force": Quantity("N", "contact force, up on the striker", "contact_force"),
    "v_p": Quantity("m/s", "plate velocity, up positive", "v_p"),
    "acceleration": Quantity("m/s^2", "plate acceleration, up positive", "acceleration"),
    "actuator_force": Quantity("N", "force of the actuator, up on the plate", ""),
    "xi_p": Quantity("m", "plate displacement, up positive", ""),
    "xi": Quantity("m", "gap between striker and plate", "xi"),
    "xi_s": Quantity("m", "striker's lowest point", ""),
}
NAMES = {q: q for q in QUANTITIES} | {
    "force": "contact_force", "f_c": "contact_force", "velocity": "v_p", "plate_velocity": "v_p",
    "accel": "acceleration", "plate_acceleration": "acceleration", "displacement": "xi_p",
    "plate_displacement": "xi_p", "gap": "xi", "sphere_position": "xi_s", "f_a": "actuator_force",
}  # fmt: skip


class Series(NamedTuple):
    """One series of a file: its name, the unit stated in the name or beside it, its values, its
    number among the columns or channels of the file from 1 on, its group, its own times (s), and
    whether it holds the times of others. Values are as in the file, integers too: what they mean
    is (values - zero)/levels."""

    name: str
    unit: str
    values: np.ndarray
    number: int
    group: str = ""
    time_s: np.ndarray | None = None
    is_time: bool = False
    zero: float = 0.0
    levels: float = 1.0


@dataclass
class Contents:
    """What a file holds: its series and `[record]` tables, the time between samples where it states
    one (s, of the first sample, and by which name), what is not used of it, and `facts`, the keys
    of every table that its format states. `multiplier`: what it says of a factor of its values.
    `interrupted`: whether empty lines stand between its rows."""

    series: list[Series]
    tables: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    spacing: tuple[float, float, str] | None = None
    notes: list[str] = field(default_factory=list)
    above: int = 0
    kind: str = "column"
    facts: dict[str, Any] = field(default_factory=dict)
    multiplier: str = ""
    interrupted: bool = False


class Format(NamedTuple):
    """A format: its name, the endings of its files, the extra that reads it, its reader."""

    name: str
    endings: tuple[str, ...]
    extra: str
    read: Callable[[Path], Contents]


def _text(path: Path) -> Contents:
    return _of_table(read_table(path, NAMES))


def evenly(count: int, step_s: float, start_s: float = 0.0) -> np.ndarray:
    """Evenly spaced times, s, shape (count,), without a second array of that size."""
    found = np.arange(count, dtype=float)
    found *= step_s
    found += start_s
    return found


def _of_table(table: TextTable) -> Contents:
    found = Contents([], inner_tables(table.comments), None, list(table.notes), table.above)
    try:
        found.spacing = spacing_s(table)
    except TableError as error:  # which only matters without times
        found.notes.append(f"{error}.")
    found.interrupted = table.interrupted
    found.multiplier = stated(table, ("multiplier", "scale_factor", "scaling_factor", "factor"))
    rising = _rising(table.columns)
    block, value, after = 0, 0, True
    for column in table.columns:
        name = plain_name(name_and_unit(column.heading, ())[0])
        unnamed = rising is None or column.number < rising.number
        counter = name[:1] == "x" or (name in SAMPLE_NUMBERS and (name or unnamed))
        if not unit_of(column.unit) and (
            plain_name(column.unit) in SAMPLE_NUMBERS - {""} or (counter and _counts(column))
        ):
            found.notes.append(f"column {column.number} numbers the samples and is not used.")
            continue
        time = column.dates or is_time(column.heading, column.unit) or column is rising
        if time and not after:
            block += 1
        after = time
        unit = column.unit or stated_unit(table, time, 0 if time else value)
        value += not time
        found.series.append(Series(
            column.heading, "s" if column.dates else unit, column.values, column.number,
            str(block + 1), is_time=time,
        ))  # fmt: skip
    times = [one.is_time for one in found.series]
    if found.spacing is None and times and times[-1] and not times[0]:  # times behind values
        found.series = [one._replace(group="") for one in found.series]
    return found


def _counts(column: TextColumn) -> bool:
    return len(column.values) > 1 and bool(np.all(np.diff(column.values) == 1.0))


def _rising(columns: list[TextColumn]) -> TextColumn | None:
    """The first column of a table without names, or that behind numbers of samples, if it rises as
    times do."""
    if len(columns) < 2 or any(column.heading for column in columns):
        return None
    if len(columns) > 2 and _counts(columns[0]):
        return _rising(columns[1:])
    rising = [c for c in columns if np.all(np.diff(c.values[np.isfinite(c.values)]) > 0.0)]
    if rising[:1] == columns[:1] and _counts(columns[0]) and not columns[0].unit:
        return None
    return columns[0] if rising and rising[0] is columns[0] else None


def _lvm(path: Path) -> Contents:
    """Every segment is a text table with facts above it."""
    text = decoded(path.read_bytes())
    starts = [one.start() for one in re.finditer(r"^Channels\b", text, re.MULTILINE)]
    if len(starts) < 2:
        return _of_table(read_text(text, NAMES))
    found = Contents([], kind="channel")
    for i, (start, end) in enumerate(pairwise([*starts, len(text)]), 1):
        part = _of_table(read_text(text[: starts[0]] + text[start:end], NAMES))
        several = len({one.group for one in part.series}) > 1
        spacing = None if any(one.is_time for one in part.series) else part.spacing
        found.series += [
            one._replace(
                group=f"{i}, {one.group}" if several else str(i),
                number=len(found.series) + j,
                time_s=None if spacing is None else evenly(len(one.values), *spacing[:2]),
            )
            for j, one in enumerate(part.series, 1)
        ]
        found.notes += part.notes
    return found


def _parquet(path: Path) -> Contents:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    found = Contents([], inner_tables((table.schema.metadata or {}).get(b"record", b"")))
    for number, name in enumerate(table.column_names, 1):
        values, part = table[name], table.schema.field(name)
        if pyarrow.types.is_time(part.type):  # of day
            whole = values.cast(f"int{part.type.bit_width}")
            values = np.asarray(whole).astype(f"m8[{part.type.unit}]")
        about = part.metadata or {}
        unit = (about.get(b"unit") or about.get(b"units") or b"").decode()
        found.series += _series(name, values, unit, number, found.notes)
    return found


def _arrays(named: Mapping[str, tuple[Any, Mapping[str, Any]]], notes: list[str]) -> Contents:
    """Contents of named arrays with attributes; the part of a name before "/" is its group."""
    found = Contents([], notes=notes)
    found.spacing = _spacing(
        {name.rpartition("/")[2]: one for name, (one, _) in named.items() if np.size(one) == 1}
    )
    for name, values, about in _fields(named):
        group, _, own = name.rpartition("/")
        unit = about.get("units", about.get("unit", ""))
        unit = unit.decode() if isinstance(unit, bytes) else str(unit)
        made = _series(own, values, unit, len(found.series) + 1, notes)
        step = next((k for k in about if plain_name(k) in ("yinc", "y_increment", "y_mult")), None)
        if step and np.asarray(values).dtype.kind in "iu":  # levels of a converter
            found.multiplier = f"{step} = {about[step]}"
        spacing = _spacing(about)
        found.series += [
            one._replace(
                group=group,
                time_s=None if spacing is None else evenly(len(one.values), *spacing[:2]),
            )
            for one in made
        ]
    pushed = [s for s in found.series if plain_name(s.name) in ("f_a_n", "command_n")]
    if any(s.group == "truth" for s in pushed):  # an export of hertzloop
        found.facts["control"] = any(bool(np.any(s.values)) for s in pushed)
    return found


def _fields(named: Mapping[str, tuple[Any, Mapping[str, Any]]]) -> Iterator[tuple[str, Any, Any]]:
    """Names, values and attributes of arrays, or of the fields of a structured one."""
    for name, (values, about) in named.items():
        parts = np.asarray(values).dtype.names or ()
        if np.size(values) != 1:
            yield from ((f"{name}/{p}", values[p], about) for p in parts)
            if not parts:
                yield name, values, about


def _spacing(about: Mapping[str, Any]) -> tuple[float, float, str] | None:
    """Time between samples and of the first, s, by attributes such as dt, fs or wf_increment."""
    facts = {}
    for name, value in about.items():
        with suppress(TypeError, ValueError, IndexError):
            facts[plain_name(name.removeprefix("wf_"))] = [repr(float(np.ravel(value)[0]))]
    return spacing_s(TextTable([], facts))


def _series(name: str, values: Any, unit: str, number: int, notes: list[str]) -> list[Series]:
    """The series of an array: a vector in any direction, or the columns of a table."""
    found = np.asarray(values)
    if found.dtype.kind == "O":  # dates or durations of another library
        with suppress(ValueError, TypeError, OverflowError):
            kind = "M8[ns]" if hasattr(found.flat[0], "year") else "m8[ns]"
            found = found.astype(kind)
    dates = found.dtype.kind in "mM"
    if dates:
        known = ~np.isnat(found)
        if found.dtype.kind == "M" and np.any(known):
            found = found - found[known][0]
        found = np.where(known, 1e-9 * found.astype("m8[ns]").astype(np.int64), np.nan)
    if found.dtype.kind not in "biuf" or found.ndim > 2 or 0 in found.shape:
        notes.append(f"{name}: holds no series of real numbers and is not used.")
        return []
    table = np.atleast_2d(found.squeeze())
    if table.shape[0] > table.shape[1]:
        table = table.T
    if len(table) > 64:
        notes.append(f"{name}: has the shape {found.shape} and is not used.")
        return []
    several = len(table) > 1
    return [
        Series(
            f"{name} {i + 1}" if several else name,
            "s" if dates else unit,
            row,
            number + i,
            is_time=dates or (not several and is_time(name, unit)),
        )
        for i, row in enumerate(table)
    ]


def _npz(path: Path) -> Contents:
    with np.load(path, allow_pickle=False) as data:
        named: dict[str, tuple[Any, dict]] = {name: (data[name], {}) for name in data.files}
    inside = named.pop("record", ("", {}))[0]
    named.pop("metadata", None)
    found = _arrays(named, [])
    found.tables = inner_tables(str(inside))
    return found


def _npy(path: Path) -> Contents:
    return _arrays({path.stem: (np.load(path, allow_pickle=False), {})}, [])


def _mat(path: Path) -> Contents:
    import scipy.io

    try:
        data = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:  # version 7.3 is HDF5
        return _hdf5(path)

    def flat(named: Mapping[str, Any], group: str) -> Iterator[tuple[str, tuple[Any, dict]]]:
        for name, value in named.items():
            if hasattr(value, "_fieldnames"):
                yield from flat(
                    {f: getattr(value, f) for f in value._fieldnames}, f"{group}{name}/"
                )
            elif not name.startswith("__"):
                yield group + name, (value, {})

    return _arrays(dict(flat(data, "")), [])


def _hdf5(path: Path) -> Contents:
    import h5py

    named: dict[str, tuple[Any, dict]] = {}
    with h5py.File(path) as file:

        def keep(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                around = {k: v for k, v in item.parent.attrs.items() if k not in ("unit", "units")}
                own = {k: v.decode() if isinstance(v, bytes) else v for k, v in item.attrs.items()}
                named[name] = item[()], around | own

        file.visititems(keep)
        inside = file.attrs.get("record", "")
    found = _arrays(named, [])
    found.tables = inner_tables(inside)
    return found


def _wav(path: Path) -> Contents:
    import scipy.io.wavfile

    rate, data = scipy.io.wavfile.read(path)
    table = np.atleast_2d(data.T)
    whole = np.issubdtype(data.dtype, np.integer)
    # Eight bits have no sign, and rest at 128.
    zero = 128.0 if data.dtype == np.uint8 else 0.0
    scale = 2.0 ** (8 * data.dtype.itemsize - 1) if whole else 1.0
    found = Contents([], spacing=(1.0 / rate, 0.0, "rate"), kind="channel")
    unit = "full scale" if whole else ""
    found.series += [Series("value", unit, row, number, zero=zero, levels=scale)
                     for number, row in enumerate(table, 1)]  # fmt: skip
    return found


def _mcap(path: Path) -> Contents:
    from hertzloop.recordings.reader import read
    from hertzloop.scene.setup import parse

    found = read(path)
    setup = parse(found.scene_toml, recorded=True)
    values = np.asarray(found.daq_values, float)
    pushed = bool(np.any(found.force.arrays.get("force_n", 0.0)))
    inside: dict[str, Any] = {"quantity": setup.quantity, "control": setup.has_law and pushed}
    if not setup.sensor.ideal:
        names = {one.name for one in fields(Filters)}
        if setup.sensor.low_pass_hz is None:
            names -= {"low_pass", "low_pass_order"}
        of_sensor = {name: getattr(setup.sensor, name) for name in names}
        inside |= {key: value for key, value in of_sensor.items() if value is not None}
    spacing = setup.every_steps * setup.step_s, 0.0, "run.step_ns"
    return Contents([Series("value", "", values, 1)], spacing=spacing, facts=inside)


def _tdms(path: Path) -> Contents:
    from nptdms import TdmsFile

    found = Contents([], kind="channel")
    # Times of day with all their digits; the numbers are read apart, as their dates would be raw.
    starts = {
        channel.path: channel.properties.get("wf_start_time")
        for group in TdmsFile.read_metadata(path, raw_timestamps=True).groups()
        for channel in group.channels() if "wf_increment" in channel.properties
    }  # fmt: skip
    known = [(start.seconds, start.second_fractions) for start in starts.values() if start]
    first = min(known, default=(0, 0))
    if known and len(known) < len(starts) and len(set(known)) > 1:
        found.notes.append("channels without wf_start_time are taken to start with the first.")
    for group in TdmsFile.read(path).groups():
        for channel in group.channels():
            unit = channel.properties.get("unit_string", channel.properties.get("Unit", ""))
            made = _series(channel.name, channel[:], str(unit), len(found.series) + 1, found.notes)
            if channel.path in starts:
                start, about = starts[channel.path], channel.properties
                late_s = 0.0
                if start:
                    late_s = start.seconds - first[0] + (start.second_fractions - first[1]) / 2**64
                late_s += float(about.get("wf_start_offset", 0.0))
                step_s = float(about["wf_increment"])
                made = [
                    one._replace(time_s=evenly(len(one.values), step_s, late_s)) for one in made
                ]
            found.series += [one._replace(group=group.name) for one in made]
    return found


# Function types of data set 58 that are no record over time.
_OTHER_FUNCTIONS = {
    2: "an auto spectrum", 3: "a cross spectrum", 4: "a frequency response function",
    5: "a transmissibility", 6: "a coherence", 7: "an auto correlation", 8: "a cross correlation",
    9: "a power spectral density", 10: "an energy spectral density",
    11: "a probability density", 12: "a spectrum",
}  # fmt: skip


def _uff(path: Path) -> Contents:
    import pyuff

    found = Contents([], kind="data set")
    sets = pyuff.UFF(str(path)).read_sets()
    for number, data in enumerate(sets if isinstance(sets, list) else [sets], 1):
        if data.get("type") != 58:
            continue
        name = str(data.get("id1") or "").strip().replace("NONE", "") or f"data set {number}"
        kind = _OTHER_FUNCTIONS.get(int(data.get("func_type", 0)), "")
        if not kind and data.get("abscissa_spec_data_type") == 18:
            kind = "a function of frequency"
        if not kind and np.iscomplexobj(data["data"]) and np.any(np.imag(data["data"])):
            kind = "a series of complex numbers"
        if kind:
            found.notes.append(f"data set {number} '{name}' is {kind}, not a time record.")
            continue
        units = [str(data.get(f"{axis}_axis_units_lab", "")).strip().replace("NONE", "")
                 for axis in ("ordinate", "abscissa")]  # fmt: skip
        size = unit_of(units[1]) if units[1] else StatedUnit("s", 1.0, "s")
        if size is None or size.si != "s":
            found.notes.append(f"data set {number} '{name}' is over '{units[1]}', not over time.")
            continue
        found.series.append(Series(
            name, units[0], np.real(np.asarray(data["data"])).astype(float), number,
            time_s=size.size * np.asarray(data["x"], float),
        ))  # fmt: skip
    return found


def _mdf(path: Path) -> Contents:
    from asammdf import MDF

    found = Contents([], kind="channel")
    with MDF(path) as file:
        for signal in file.iter_channels():
            made = _series(signal.name, signal.samples, str(signal.unit or ""),
                           len(found.series) + 1, found.notes)  # fmt: skip
            time_s = np.asarray(signal.timestamps, float)
            group = str(signal.group_index + 1)
            found.series += [one._replace(time_s=time_s, group=group) for one in made]
    return found


def _scope(path: Path) -> Contents:
    from RigolWFM.wfm import Wfm

    found = Contents([], kind="channel")
    for channel in Wfm.from_file(str(path)).channels:
        if channel.volts is None or not len(channel.volts):
            continue
        unit = {"w": "W", "a": "A", "v": "V"}.get(getattr(channel.unit, "name", ""), "?")
        values, time_s = (np.asarray(x, float) for x in (channel.volts, channel.times))
        found.series.append(
            Series(channel.name, unit, values, channel.channel_number, time_s=time_s)
        )
    return found


def inner_tables(text: str | bytes) -> list[dict[str, Any]]:
    """The `[record]` tables of comment lines, at least one; other comments mean nothing. Raises
    RecordError."""
    said = text.decode("utf-8") if isinstance(text, bytes) else str(text)
    first = re.search(r"\[?\[record\]", said)
    try:
        return (record_tables(said[first.start() :]) if first else []) or [{}]
    except tomllib.TOMLDecodeError as error:
        raise RecordError(
            f"the record table in the comments is not valid TOML: {error}."
        ) from error


def record_tables(text: str) -> list[dict[str, Any]]:
    """The `[record]` table of a TOML text, or its `[[record]]` tables. Raises TOMLDecodeError and
    RecordError."""
    found = tomllib.loads(text).get("record", [])
    tables = found if isinstance(found, list) else [found]
    for table in tables:
        if not isinstance(table, dict):
            raise RecordError(f"record = {found!r}: is not a table. Write [record] or [[record]].")
    return tables


FORMATS = (
    Format("text table", (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), "", _text),
    Format("Parquet", (".parquet",), "", _parquet),
    Format("NumPy", (".npz",), "", _npz),
    Format("NumPy array", (".npy",), "", _npy),
    Format("MATLAB", (".mat",), "", _mat),
    Format("WAV", (".wav",), "", _wav),
    Format("recording of hertzloop", (".mcap",), "", _mcap),
    Format("HDF5", (".h5", ".hdf5"), "h5", _hdf5),
    Format("TDMS", (".tdms",), "records", _tdms),
    Format("UFF 58", (".uff", ".unv"), "records", _uff),
    Format("LabVIEW LVM", (".lvm",), "", _lvm),
    Format("MDF", (".mf4", ".mdf"), "mdf", _mdf),
    Format("oscilloscope", (".wfm", ".bin", ".isf", ".trc"), "scopes", _scope),
)
ENDINGS = {ending: one for one in FORMATS for ending in one.endings}


def quantity_of(name: str) -> str | None:
    """The quantity that a name means, such as `v_p_mm_s` or "Force [N]"; None if it means none."""
    stem = "" if name[:1] in tuple("-|") else plain_name(name_and_unit(name, NAMES)[0])
    return NAMES.get(stem) or NAMES.get(re.sub(r"_?\d+$", "", stem))
