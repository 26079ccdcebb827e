"""Measured records: values over time, with what is known of the measurement.

A record is one channel of one impact. A file holds one or several: its `[record]` table, or its
`[[record]]` tables with one for each channel, stand in a TOML file of the same name beside it, or
in lines of a CSV file that begin with `#`. A TOML file can also name the files of its channels.
"""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.text_files import text_of
from hertzloop.identification.records.formats import (
    ENDINGS,
    NAMES,
    QUANTITIES,
    Contents,
    Quantity,
    RecordError,
    Series,
    evenly,
    quantity_of,
    record_tables,
)
from hertzloop.identification.records.text_tables import TIMES, TableError
from hertzloop.identification.records.units import StatedUnit, name_and_unit, plain_name, unit_of
from hertzloop.sensors.acquisition import HIGHEST_ORDER
from hertzloop.sensors.acquisition import LOW_PASSES as CAUSAL
from hertzloop.sensors.acquisition import converter_step as adc_step

__all__ = [
    "FILTERS", "QUANTITIES", "WITHOUT_CONTROL", "Measured", "Quantity", "Record", "RecordError",
    "clipped", "converter_step", "measured_of", "read_record", "read_records",
]  # fmt: skip
_EXAMPLES = {"N": "N, kN, mN, lbf", "m/s": "m/s, mm/s, um/s, in/s", "m/s^2": "m/s^2, g, mm/s^2",
             "m": "m, mm, um, nm"}  # fmt: skip
WITHOUT_CONTROL = "The records are simulated without control: no law, no latency, no force."
FILTERS = ("low_pass_hz", "ac_coupling_hz", "resonance_hz", "resonance_damping")
LOW_PASSES = (*CAUSAL, "sigma-delta")
OF_PLATE = ("v_p", "acceleration", "xi_p")  # quantities with a measuring point


def of_chain(key: str) -> bool:
    """Whether a scene key is of the measuring chain alone: no simulation depends on it."""
    return key.startswith("sensors.") and key != "sensors.mass_kg"


_FEWEST = 8  # samples of a record
_CHOICES = ("quantity", "column", "channel", "group")  # keys that choose a series
_AT_REST = 0.1  # of the largest value, up to which a sensor is at rest
_PLATEAU = 3  # equal extreme values in a row that count as clipped
_LEVELS = 4096  # distinct values; more than these are no visible converter
DEFAULT_GAIN_UNCERTAINTY = 0.03
DEFAULT_CLOCK_PPM = 50.0


@dataclass(frozen=True)
class Measured:
    """The `[record]` table: what is known of a measurement.

    `quantity`, `unit`: what the values are. `column`, `channel`: which column or channel of the
    file holds them, by its name or its number from 1 on; `group`: of which group or table.
    `time_column`, `time_unit`: the same of the times.
    `sensitivity`: units of the file for one unit of `unit`, e.g. V for N (1 if left out), and
    `sensitivity_uncertainty`, relative standard deviation (inf if it is unknown). `rate_hz`: where
    the file has no times.
    `clock_tolerance_ppm`: standard deviation of the clock's relative error. `low_pass_hz`,
    `low_pass`, `low_pass_order`, `ac_coupling_hz`, `resonance_hz`, `resonance_damping`: filters of
    the measuring chain.
    `range`, `bits`: of the converter, in `unit`. `point_m`: measuring point, m. `set`: scene keys
    that hold for this record only, such as its drop height. `control`: whether the law was on; if
    left out, it was where the force of the actuator is the quantity or has a free key. `clock`: a
    name that channels of one drop share which were sampled by one clock; channels of one file with
    equal times share it unless another one is named.
    """

    quantity: str | None = None
    unit: str | None = None
    column: str | int | None = None
    channel: str | int | None = None
    group: str | int | None = None
    time_column: str | int | None = None
    time_unit: str | None = None
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
    low_pass: str = "butterworth"
    low_pass_order: int = 1

    @property
    def filtered(self) -> bool:
        """Whether the table names a filter."""
        return any(f is not None for f in (self.low_pass_hz, self.ac_coupling_hz,
                                           self.resonance_hz))  # fmt: skip


@dataclass(frozen=True)
class Record:
    """A measured record: one channel of one impact.

    Args:
        name: name in messages.
        time_s: times by the record's clock, s, shape (samples,), rising; the zero is arbitrary.
        value: in the SI unit of the quantity, shape (samples,); nan where nothing is known.
        quantity: "contact_force", "actuator_force" (N), "v_p" (m/s), "acceleration" (m/s^2),
            "xi_p", "xi" or "xi_s" (m).
        measured: the `[record]` table: filters, range, uncertainties.
        sha256: digest of the file, "" of a record from memory.
        notes: sentences on what is not used of the file.
        source: where times and values stand in the file, and in which units.
        hit: number of the hit, whose striker has a speed of its own; 0 of an only one.

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
    source: str = ""
    hit: int = 0

    def __post_init__(self) -> None:
        _known_quantity(self.quantity, self.name)
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
        rises = self.time_s[1:] > self.time_s[:-1]
        if not np.all(rises):
            at = int(np.argmin(rises))
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


def _known_quantity(quantity: str | None, name: str) -> str:
    if quantity not in QUANTITIES:
        raise RecordError(
            f"record.quantity = '{quantity}': not known in {name}. Give one of "
            f"{', '.join(QUANTITIES)}."
        )
    return quantity


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
        same = np.concatenate([[False], value == extreme, [False]])
        for start, end in np.flatnonzero(np.diff(same.astype(int))).reshape(-1, 2):
            if end - start >= _PLATEAU:
                found[start:end] = True
    return found


def converter_step(record: Record) -> float:
    """Distance of two levels of the converter, in SI units; zero if none is visible."""
    if record.measured.bits and record.measured.range:
        step = adc_step(record.measured.bits, record.measured.range)
        return _factor(record.quantity, record.measured) * step
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
    """Read a file of one record. Arguments and errors are those of `read_records`."""
    found = read_records(path, given)
    if len(found) > 1:
        raise RecordError(
            f"{path}: holds {len(found)} records, one for each [[record]] table. Read them with "
            "read_records."
        )
    return found[0]


def read_records(path: Path, given: Mapping[str, Any] | None = None) -> list[Record]:
    """Read the records of a file: one for each of its `[[record]]` tables, or one.

    Args:
        path: a file of one of the formats in `formats.FORMATS`, or a TOML file whose tables name
            such files, relative to it.
        given: keys of the `[record]` table that replace those of the file.

    Raises:
        RecordError: the file is not a record, a table is wrong, or it does not say which channel.
        ModuleNotFoundError: the format needs a package of an extra.
    """
    if path.suffix == ".toml":
        return _of_several_files(path, dict(given or {}))
    contents = _contents(path)
    tables, beside = contents.tables, path.with_suffix(".toml")
    if beside.is_file() and (named := _tables(beside)):
        tables = [(tables[0] if len(tables) == 1 else {}) | table for table in named]
    chosen = {key: value for key, value in (given or {}).items() if key in _CHOICES}
    if len(tables) > 1 and chosen:
        tables = [t for t in tables if all(t.get(k) == v for k, v in chosen.items())] or [{}]
    digest = ""
    if path.stat().st_size < 1 << 30:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    found: list[Record] = []
    for table in tables:
        whole = contents.facts | table | dict(given or {})
        one = _made(path.name, contents, measured_of(whole, path.name), whole, digest)
        if len(tables) > 1:
            one = replace(one, name=f"{path.name}, {one.quantity}")
            if np.array_equal(one.time_s, (found or [one])[0].time_s):
                measured = replace(one.measured, clock=one.measured.clock or path.name)
                one = replace(one, measured=measured, time_s=(found or [one])[0].time_s)
        found.append(one)
    return found


def holds_records(path: Path) -> bool:
    """Whether the name of a file, or what is in a TOML file, says that it holds records."""
    known = path.suffix.lower() in ENDINGS
    return known or (path.suffix == ".toml" and path.is_file() and bool(_tables(path)))


def _of_several_files(path: Path, given: dict[str, Any]) -> list[Record]:
    """The records of a TOML file whose tables name the files. Raises RecordError."""
    found = []
    for table in _tables(path):
        if not isinstance(file := table.pop("file", None), str):
            raise RecordError(
                f"record.file: a [[record]] table of {path.name} names no file. Give the path of "
                "its record, relative to this file."
            )
        found += read_records(path.parent / file, table | given)
    if not found:
        raise RecordError(f"{path}: has no [[record]] table. Give one for each channel.")
    return found


def _tables(path: Path) -> list[dict[str, Any]]:
    """The `[record]` or `[[record]]` tables of a TOML file. Raises RecordError."""
    try:
        return record_tables(text_of(path.read_bytes()))
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: is not valid TOML: {error}.") from error


def _contents(path: Path) -> Contents:
    """What a file holds. Raises RecordError and ModuleNotFoundError."""
    if not path.is_file():
        raise RecordError(f"{path}: there is no such file. Give the path of a record.")
    form = ENDINGS.get(path.suffix.lower())
    if form is None:
        raise RecordError(
            f"{path}: '{path.suffix}' is not a known format. Give one of "
            f"{', '.join(sorted(ENDINGS))}."
        )
    try:
        return form.read(path)
    except (RecordError, ModuleNotFoundError):
        raise
    except TableError as error:
        raise RecordError(f"{path}: {error}.") from error
    except Exception as error:  # every library has its own ways to say that a file is damaged
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: cannot be read as {path.suffix[1:]}: {words}.") from error


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
        finite = number and (
            math.isfinite(value) or (key == "sensitivity_uncertainty" and value > 0)
        )
        good = finite and (value >= 0 if least_ok else value != 0)
        if not good or (key != "sensitivity" and value < 0):
            raise RecordError(f"record.{key} = {value}: must be a positive number in {name}.")
    places = [(key, (str, int), "a name or a number from 1 on")
              for key in ("column", "channel", "group", "time_column")]  # fmt: skip
    names = [(key, (str,), "a name") for key in ("clock", "unit", "time_unit")]
    for key, kind, what in (("control", (bool,), "true or false"), *names, *places):
        wrong = isinstance(values.get(key), bool) and kind != (bool,)
        if key in values and (wrong or not isinstance(values[key], kind)):
            raise RecordError(f"record.{key} = {values[key]}: must be {what} in {name}.")
    found = Measured(**values)
    if found.low_pass not in LOW_PASSES:
        raise RecordError(
            f"record.low_pass = '{found.low_pass}': not known in {name}. Give one of "
            f"{', '.join(LOW_PASSES)}."
        )
    order = found.low_pass_order
    if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= HIGHEST_ORDER:
        raise RecordError(
            f"record.low_pass_order = {order}: must be a whole number from 1 to {HIGHEST_ORDER} "
            f"in {name}."
        )
    if found.low_pass == "sigma-delta" and "low_pass_order" in values:
        raise RecordError(
            f"record.low_pass_order = {order}: a sigma-delta converter in {name} has no order. "
            "Leave it out."
        )
    named = next((key for key in ("low_pass", "low_pass_order") if key in values), None)
    if named and found.low_pass_hz is None:
        raise RecordError(
            f"record.{named} = {values[named]}: has no corner in {name}. Give record.low_pass_hz."
        )
    return found


def _factor(quantity: str, measured: Measured) -> float:
    """SI value of one of the file's units."""
    si = QUANTITIES[quantity].unit
    unit = unit_of(measured.unit or si)
    if measured.sensitivity_uncertainty == math.inf and (unit is None or unit.si != si):
        return 1.0 / measured.sensitivity  # the gain has this unit
    if unit is None or unit.si != si:
        raise RecordError(
            f"record.unit = '{measured.unit}': not a unit of {quantity}. Give one of "
            f"{_EXAMPLES[si]}."
        )
    return unit.size / measured.sensitivity


def _matches(series: Series, said: str | int) -> bool:
    if isinstance(said, int):
        return series.number == said
    stem, unit = name_and_unit(series.name, NAMES)
    stated = unit or series.unit.strip(" ()[]")
    return said in (series.name, stem, f"{stem} ({stated})", stated)


def _named(series: Series, contents: Contents) -> str:
    """A series in words, such as "column 2 'Force [N]'"."""
    name = f" '{series.name}'" if series.name else ""
    several = len({s.group for s in contents.series}) > 1 and series.group
    return f"{contents.kind} {series.number}{name}" + (
        f" of group '{series.group}'" if several else ""
    )


def _series_of(name: str, contents: Contents, measured: Measured) -> tuple[Series, list[str]]:
    """The series that is the record, and notes. Raises RecordError if several could be it."""
    every = [s for s in contents.series if not s.is_time]
    left = every
    explicit = False
    for key in ("group", "channel", "column"):
        said = getattr(measured, key)
        if said is None:
            continue
        explicit = explicit or key != "group"
        if key == "group":
            groups = list(dict.fromkeys(s.group for s in every))
            wanted = groups[said - 1] if isinstance(said, int) and 0 < said <= len(groups) else said
            kept = [s for s in left if s.group == str(wanted)]
        elif key == "channel" and isinstance(said, int) and contents.kind == "column":
            kept = left[said - 1 : said] if said > 0 else []
        else:
            exact = [s for s in left if s.name == said]
            kept = exact or [s for s in left if _matches(s, said)]
        if not kept:
            raise RecordError(
                f"record.{key} = {said!r}: not a {key} of {name}. It has "
                f"{', '.join(_named(s, contents) for s in left)}."
            )
        left = kept
    notes: list[str] = []
    wanted_quantity = NAMES.get(measured.quantity or "", measured.quantity)
    if wanted_quantity is None and not explicit:
        left = [s for s in left if quantity_of(s.name)]
    elif len(left) > 1:
        left = [s for s in left if quantity_of(s.name) == wanted_quantity] or left
    if not left:
        raise RecordError(
            f"{name}: no column is a known quantity; the columns are "
            f"{', '.join(_named(s, contents) for s in contents.series)}. Name a column such as "
            "contact_force_n or v_p_m_s, or give record.quantity and record.column. "
            f"{' '.join(contents.notes)}".strip()
        )
    alike = [s for s in left if quantity_of(s.name) == quantity_of(left[0].name)]
    if len(alike) > 1:
        key = "group" if len({s.group for s in alike}) == len(alike) else contents.kind
        key = "channel" if key == "data set" else key
        value = f'"{alike[0].group}"' if key == "group" else alike[0].number
        raise RecordError(
            f"{name}: {len(alike)} series could be the record: "
            f"{', '.join(_named(s, contents) for s in alike)}. Choose one, for example with "
            f"record.{key} = {value}."
        )
    others = [s.name or str(s.number) for s in every if s is not left[0]]
    if others and not explicit:
        notes.append(
            f"{name}: {contents.kind} {left[0].name} is used, and {', '.join(others)} "
            f"{'is' if len(others) == 1 else 'are'} not. "
            "Choose with record.column."
        )
    return left[0], notes


def _times_of(
    name: str, series: Series, contents: Contents, measured: Measured
) -> tuple[np.ndarray, str]:
    """Times of a series, s, and where they come from. Raises RecordError."""
    rate = measured.rate_hz
    count = len(series.values)
    if measured.time_column is not None:
        found = [s for s in contents.series if _matches(s, measured.time_column)]
        if len(found) != 1:
            raise RecordError(
                f"record.time_column = {measured.time_column!r}: means {len(found)} columns of "
                f"{name}. Give the number of one of "
                f"{', '.join(_named(s, contents) for s in contents.series)}."
            )
    elif series.time_s is not None:
        return _checked(name, series.time_s, f"of the {contents.kind}", contents, measured)
    else:
        found = [s for s in contents.series if s.is_time and len(s.values) == count
                 and s.group in (series.group, "")]  # fmt: skip
        found = [s for s in found if np.nanmax(s.values, initial=0) > np.nanmin(s.values, initial=0)
                 ] or found[:1]  # fmt: skip
    if found:
        several = [_in_seconds(name, s, contents, measured) for s in found]
        for other, words in several[1:]:
            shift = (other - other[0]) - (several[0][0] - several[0][0][0])
            if not np.nanmax(np.abs(shift)) < 0.5 * np.nanmedian(np.abs(np.diff(other))):
                raise RecordError(
                    f"{name}: two columns of times disagree: {several[0][1]} and {words}. Choose "
                    f"one, for example record.time_column = {found[0].number}."
                )
        return _checked(name, *several[-1], contents, measured)
    if contents.spacing is not None:
        step, start, words = contents.spacing
        if rate and abs(rate * step - 1.0) > 1e-2:
            raise RecordError(
                f"record.rate_hz = {rate:g}: '{words}' in {name} says {1.0 / step:.9g} Hz. Leave "
                "record.rate_hz out, or correct it."
            )
        return _even(name, count, step, start, contents), f"{step:.9g} s apart by '{words}'"
    if rate:
        return _even(name, count, 1.0 / rate, 0.0, contents), f"by record.rate_hz = {rate:g}"
    raise RecordError(
        f"{name}: has no column time_s; the columns are "
        f"{', '.join(s.name or str(s.number) for s in contents.series)}. Add one, give "
        "record.time_column, or give record.rate_hz in samples per second. "
        f"{' '.join(contents.notes)}".strip()
    )


def _even(name: str, count: int, step_s: float, start_s: float, contents: Contents) -> np.ndarray:
    """Evenly spaced times, s, shape (count,). Raises RecordError if rows may be missing."""
    if contents.interrupted:
        raise RecordError(
            f"{name}: empty lines stand between rows without times. Fill or remove them."
        )
    return evenly(count, step_s, start_s)


def _in_seconds(
    name: str, series: Series, contents: Contents, measured: Measured
) -> tuple[np.ndarray, str]:
    """Times in s and words on them. Raises RecordError for an unknown unit."""
    own = name_and_unit(series.name, TIMES)[1]
    stated = measured.time_unit or _one_unit(name, series, own, contents)
    unit = unit_of(stated) if stated else StatedUnit("s", 1.0, "s")
    if unit is None or unit.si != "s":
        raise RecordError(
            f"record.time_unit: '{stated}' of {_named(series, contents)} in {name} is not a known "
            "unit of time. Give one of s, ms, us, ns."
        )
    words = unit.symbol if stated else "s, which the file does not state"
    values = np.asarray(series.values, float)
    values = values if unit.size == 1.0 else values * unit.size
    return values, f"{_named(series, contents)} in {words}"


def _one_unit(name: str, series: Series, own: str, contents: Contents) -> str:
    """The unit in the name of a series or beside it. Raises RecordError if they disagree."""
    if unit_of(own) and unit_of(series.unit) and unit_of(own) != unit_of(series.unit):
        raise RecordError(
            f"{name}: {_named(series, contents)} has two units, '{own}' and '{series.unit}'. "
            "Correct one of them in the file."
        )
    return own if unit_of(own) or not series.unit else series.unit


def _checked(
    name: str, time_s: np.ndarray, words: str, contents: Contents, measured: Measured
) -> tuple[np.ndarray, str]:
    """Times that agree with the rate in the table and, but for their unit, with the file."""
    known = np.isfinite(time_s)
    known = time_s if np.all(known) else time_s[known]
    mean = (known[-1] - known[0]) / (len(known) - 1) if len(known) > 1 else 0.0
    rate = measured.rate_hz
    if rate and mean > 0.0 and abs(rate * mean - 1.0) > 1e-2:
        raise RecordError(
            f"record.rate_hz = {rate:g}: the times of {name} ({words}) say {1.0 / mean:.6g} Hz. "
            "Leave record.rate_hz out, or correct it."
        )
    if rate and np.any(known[1:] <= known[:-1]):  # rounded times
        evened = _even(name, len(time_s), 1.0 / rate, 0.0, contents)
        return evened, f"by record.rate_hz = {rate:g}"
    if contents.spacing is not None and "not state" in words and mean > 0.0:
        turns = math.log10(mean / contents.spacing[0])
        if abs(turns) > 2.5 and abs(turns - round(turns)) < 1e-3:
            raise RecordError(
                f"{name}: times without a unit rise by {mean:.6g}, and '{contents.spacing[2]}' "
                f"says {contents.spacing[0]:.6g} s. Give record.time_unit."
            )
    said = contents.spacing
    if said is not None and abs(mean / said[0] - 1.0) > 1e-2:
        words += f" ({mean:.6g} s apart, not {said[0]:.6g} s as '{said[2]}')"
    apart_s = float(np.spacing(max(np.max(known), -np.min(known)))) if mean > 0.0 else 0.0
    if apart_s > 0.01 * mean:
        raise RecordError(
            f"{name}: its times are so large that a double holds them to "
            f"{apart_s:.2g} s only. Leave time_s out and give "
            "record.rate_hz."
        )
    return time_s, words


def _scaled(
    name: str, series: Series, quantity: str, measured: Measured, table: Mapping[str, Any],
    contents: Contents, notes: list[str],
) -> tuple[Measured, str]:  # fmt: skip
    """The table with the unit that the file states, and words. Raises RecordError."""
    stated = _one_unit(name, series, name_and_unit(series.name, NAMES)[1], contents).strip(" ()[]")
    if not stated:  # what follows a known name, such as force_lb, may be a unit
        plain = plain_name(series.name)
        ends = [plain[len(n) + 1 :] for n in NAMES if plain.startswith(f"{n}_")]
        stated = min((end for end in ends if not end.isdigit()), key=len, default="")
        stated = "" if plain in NAMES else stated
    unit, si = unit_of(stated), QUANTITIES[quantity].unit
    unknown = measured.sensitivity_uncertainty == math.inf
    if contents.multiplier not in ("", "1", "1.0") and "sensitivity" not in table:
        raise RecordError(
            f"{name}: states a factor of its values, '{contents.multiplier}', which may be part of "
            "them or not. Give record.sensitivity, units of the file for one "
            f"{measured.unit or si}."
        )
    sensitive = "sensitivity" in table or unknown
    if unit is not None and unit.si == si:
        if measured.unit is None:
            measured = replace(measured, unit=stated)
        elif unit_of(measured.unit) != unit and not sensitive:
            notes.append(f"{name}: states '{stated}'; record.unit = '{measured.unit}' replaces it.")
    elif stated and (measured.unit is None and not (
        sensitive and (unit is None or unit.si not in {q.unit for q in QUANTITIES.values()})
    )):  # fmt: skip
        what = "no unit that is known" if unit is None else f"not a unit of {quantity}"
        raise RecordError(
            f"{name}: {_named(series, contents)} is in '{stated}', which is {what}. Give "
            f"record.sensitivity, {stated} for one {si}, or record.unit, one of {_EXAMPLES[si]}. "
            "Of an unknown sensitivity, write record.sensitivity_uncertainty = inf."
        )
    words = (
        unit.symbol if unit else stated or f"{measured.unit or si}, which the file does not state"
    )
    if unknown:
        words += ", of an unknown sensitivity"
    elif sensitive:
        words += f", {measured.sensitivity:g} for one {measured.unit or si}"
    return measured, words


def _made(
    name: str, contents: Contents, measured: Measured, table: Mapping[str, Any], digest: str
) -> Record:
    notes = [f"{name}: {note}" for note in contents.notes]
    if not contents.series or all(len(one.values) == 0 for one in contents.series):
        reasons = " ".join(contents.notes)
        raise RecordError(f"{name}: has no samples. {reasons or 'Give a record of one impact.'}")
    series, more = _series_of(name, contents, measured)
    notes += more
    named = NAMES.get(measured.quantity or "", measured.quantity)
    quantity = _known_quantity(named or quantity_of(series.name), name)
    measured, words = _scaled(name, series, quantity, measured, table, contents, notes)
    factor = _factor(quantity, measured)
    factor /= series.levels
    value = series.values
    if factor != 1.0 or series.zero or value.dtype != float:
        value = np.subtract(value, series.zero, dtype=float)
        value *= factor
    time_s, times = _times_of(name, series, contents, measured)
    if len(time_s) == len(value):
        if not (np.isfinite(time_s[-1]) or np.isfinite(value[-1])):  # beside a longer table
            ends = np.isfinite(time_s) | np.isfinite(value)
            last = len(ends) - int(np.argmax(ends[::-1])) if np.any(ends) else 0
            time_s, value = time_s[:last], value[:last]
        number = np.count_nonzero(np.isfinite(time_s))
        if number == 0:
            raise RecordError(
                f"{name}: no time is a number. Write numbers with a decimal point, in seconds."
            )
        if number < len(time_s):
            notes.append(f"{name}: {len(time_s) - number} samples have no time and are not used.")
            known = np.isfinite(time_s)
            time_s, value = time_s[known], value[known]
    number = np.count_nonzero(np.isfinite(value))
    if gone := len(value) - number:
        if number < max(_FEWEST, 0.5 * len(value)):
            raise RecordError(
                f"{name}: {gone} of {len(value)} samples are not numbers. Give a record without "
                "gaps."
            )
        notes.append(f"{name}: {gone} samples are not numbers and are not used.")
    lines = f"{contents.above} line{'s' * (contents.above != 1)}"
    above = f"; {lines} above the table" if contents.above else ""
    source = f"time: {times}; {quantity}: {_named(series, contents)} in {words}{above}"
    measured = replace(measured, quantity=quantity)
    return Record(name, time_s, value, quantity, measured, digest, tuple(notes), source)
