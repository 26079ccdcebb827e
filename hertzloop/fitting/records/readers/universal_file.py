"""Read time records in data sets 58 of universal files."""

from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.units import StatedUnit, unit_of

# Function types of data set 58 that are no record over time.
_OTHER_FUNCTIONS = {
    2: "an auto spectrum",
    3: "a cross spectrum",
    4: "a frequency response function",
    5: "a transmissibility",
    6: "a coherence",
    7: "an auto correlation",
    8: "a cross correlation",
    9: "a power spectral density",
    10: "an energy spectral density",
    11: "a probability density",
    12: "a spectrum",
}


def data_sets(path: Path) -> list[dict[str, Any]]:
    """Return all data sets of a universal file; pyuff raises plain exceptions for damaged files."""
    import pyuff  # An extra installs it.

    found = pyuff.UFF(str(path)).read_sets()
    return found if isinstance(found, list) else [found]


def read_uff(path: Path) -> FileContents:
    """Read the data sets 58 of a universal file that are functions of time."""
    found = FileContents([], kind="data set")
    for number, data in enumerate(data_sets(path), 1):
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
        units = [
            str(data.get(f"{axis}_axis_units_lab", "")).strip().replace("NONE", "")
            for axis in ("ordinate", "abscissa")
        ]
        size = unit_of(units[1]) if units[1] else StatedUnit("s", 1.0, "s")
        if size is None or size.si != "s":
            found.notes.append(f"data set {number} '{name}' is over '{units[1]}', not over time.")
            continue
        found.series.append(
            Series(
                name,
                units[0],
                np.real(np.asarray(data["data"])).astype(float),
                number,
                time_s=size.size * np.asarray(data["x"], float),
            )
        )
    return found
