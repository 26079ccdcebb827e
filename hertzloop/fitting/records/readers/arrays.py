"""Series of named arrays with attributes."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.spacing import StatedSpacing, stated_spacing
from hertzloop.fitting.records.text.column_names import is_time
from hertzloop.fitting.records.units import plain_name


def contents_of_arrays(named: Mapping[str, tuple[Any, Mapping[str, Any]]]) -> FileContents:
    """Return the series of arrays.

    Args:
        named: arrays and their attributes by name; the part of a name before "/" is its group.
    """
    found = FileContents([])
    found.spacing = _spacing_of_attributes(
        {name.rpartition("/")[2]: one for name, (one, _) in named.items() if np.size(one) == 1}
    )
    for name, values, about in _array_fields(named):
        group, _, own = name.rpartition("/")
        unit = about.get("units", about.get("unit", ""))
        unit = unit.decode() if isinstance(unit, bytes) else str(unit)
        step = next((k for k in about if plain_name(k) in ("yinc", "y_increment", "y_mult")), None)
        if step and np.asarray(values).dtype.kind in "iu":  # levels of a converter
            found.multiplier = f"{step} = {about[step]}"
        add_array(found, own, values, unit, group, _spacing_of_attributes(about))
    pushed = [s for s in found.series if plain_name(s.name) in ("f_a_n", "command_n")]
    if any(s.group == "truth" for s in pushed):  # an export of hertzloop
        found.facts["control"] = any(bool(np.any(s.values)) for s in pushed)
    return found


def add_array(
    contents: FileContents,
    name: str,
    values: Any,
    unit: str,
    group: str = "",
    times: StatedSpacing | np.ndarray | None = None,
) -> None:
    """Add the series of an array to others: a vector in any direction, or the columns of a table.

    An array without numbers is noted.

    Args:
        contents: of the file.
        name: of the array.
        values: numbers, dates or durations.
        unit: that the file states.
        group: of the file.
        times: of the samples, s, or their spacing; None if other series hold them.
    """
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
        contents.counted += 1
        contents.notes.append(f"{name}: holds no series of real numbers and is not used.")
        return
    table = np.atleast_2d(found.squeeze())
    if table.shape[0] > table.shape[1]:
        table = table.T
    if len(table) > 64:
        contents.counted += 1
        contents.notes.append(f"{name}: has the shape {found.shape} and is not used.")
        return
    several = len(table) > 1
    contents.series += [
        Series(
            f"{name} {i}" if several else name,
            "s" if dates else unit,
            row,
            contents.counted + i,
            group,
            times.times(len(row)) if isinstance(times, StatedSpacing) else times,
            dates or (not several and is_time(name, unit)),
        )
        for i, row in enumerate(table, 1)
    ]
    contents.counted += len(table)


def _array_fields(
    named: Mapping[str, tuple[Any, Mapping[str, Any]]],
) -> Iterator[tuple[str, Any, Any]]:
    """Yield names, values and attributes of arrays, or of the fields of a structured one."""
    for name, (values, about) in named.items():
        parts = np.asarray(values).dtype.names or ()
        if np.size(values) != 1:
            yield from ((f"{name}/{p}", values[p], about) for p in parts)
            if not parts:
                yield name, values, about


def _spacing_of_attributes(about: Mapping[str, Any]) -> StatedSpacing | None:
    """Return the time between samples and of the first, s, by attributes such as dt or fs."""
    facts = {}
    for name, value in about.items():
        with suppress(TypeError, ValueError, IndexError):
            facts[plain_name(name.removeprefix("wf_"))] = [repr(float(np.ravel(value)[0]))]
    return stated_spacing(facts)
