"""Files of modes, from a finite-element program, a modal test or `hertzloop scene modes`.

One row a mode, by rising frequency: frequency_hz, loss_factor, modal_mass_kg, shape_contact and,
where the actuator pushes or the sensor measures elsewhere, shape_actuator and shape_sensor; CSV
with a heading, or NPZ with one array a column. Shapes are in any unit whose square goes with that
of the modal mass. NPZ may hold x_m, y_m and shape_grid (modes, x, y) besides, for the picture.
residual_flexibility_m_n, of all modes that are not in the file, is one number: "#
residual_flexibility_m_n = 1e-8" above the heading of a CSV, an array without dimensions in NPZ.

omega_rad_s and per_modal_mass_1_kg may stand in for frequency and mass: what the plant computes
with, without the rounding of 2 pi and of a division. `hertzloop scene modes` writes both.
"""

import csv
import io
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.common.text_files import text_of

SUFFIXES = (".csv", ".npz")
RESIDUAL = "residual_flexibility_m_n"
_COLUMNS = ("frequency_hz", "loss_factor", "modal_mass_kg", "shape_contact")
_INSTEAD = {"frequency_hz": "omega_rad_s", "modal_mass_kg": "per_modal_mass_1_kg"}
_OPTIONAL = ("shape_actuator", "shape_sensor")
_GRID = ("x_m", "y_m", "shape_grid")
_MOST_BYTES = 1 << 28  # unpacked
# Least and largest value that can be, and in words.
_RANGES = {
    "frequency_hz": (0.0, 1e9, "0 to 1e9 Hz"),
    "omega_rad_s": (0.0, 2.0 * math.pi * 1e9, "0 to 6e9 rad/s"),
    "loss_factor": (0.0, 1.0, "0 to 1"),
    "modal_mass_kg": (1e-12, 1e12, "above 0, 1e-12 to 1e12 kg"),
    "per_modal_mass_1_kg": (1e-12, 1e12, "above 0, 1e-12 to 1e12 1/kg"),
    RESIDUAL: (0.0, 1.0, "0 to 1 m/N"),
}


@dataclass(frozen=True)
class ModeTable:
    """What a file of modes says; arrays (modes,), `grid`: x (nx,), y (ny,) in m, shapes (modes, nx,
    ny), or None; the residual flexibility in m/N, or None; `shape_sensor`: None of a sensor at the
    contact point."""

    omega_rad_s: np.ndarray
    loss_factor: np.ndarray
    per_modal_mass_1_kg: np.ndarray
    shape_contact: np.ndarray
    shape_actuator: np.ndarray
    residual_flexibility_m_n: float | None = None
    grid: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    shape_sensor: np.ndarray | None = None


def read_modes(name: str, content: bytes) -> ModeTable:
    """Modes of a file by its name and bytes. Raises ValueError with one sentence, which says where
    and what would be right."""
    suffix = "." + name.rpartition(".")[2].lower()
    if suffix not in SUFFIXES:
        raise ValueError(
            f"{name} is not a file of modes; its name must end in {', '.join(SUFFIXES)}"
        )
    try:
        found = _from_csv(content) if suffix == ".csv" else _from_npz(content)
    except Exception as error:  # whatever a damaged file makes a library raise
        raise ValueError(f"{name} cannot be read as {suffix[1:]}: {error}") from error
    try:
        return _table(found)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _from_csv(content: bytes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    heading: list[str] = []
    for number, line in enumerate(text_of(content).splitlines(), 1):
        if line.lstrip().startswith("#"):
            key, _, value = line.lstrip("# ").partition("=")
            if key.strip() == RESIDUAL:
                found[RESIDUAL] = value.strip()
            continue
        cells = [cell.strip() for row in csv.reader([line]) for cell in row]
        if cells and not heading:
            heading = cells
            found |= {key: [] for key in heading}
        elif cells:
            if len(cells) != len(heading):
                raise ValueError(
                    f"line {number}: {len(cells)} values under {len(heading)} headings"
                )
            for key, cell in zip(heading, cells, strict=True):
                found[key].append(cell)
    return found


def _from_npz(content: bytes) -> dict[str, Any]:
    with zipfile.ZipFile(io.BytesIO(content)) as parts:
        size = sum(part.file_size for part in parts.infolist())
    if size > _MOST_BYTES:
        raise ValueError(f"it unpacks to {size:.2g} bytes, the most is {_MOST_BYTES:.2g}")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {key: arrays[key] for key in arrays.files}


def _table(found: Mapping[str, Any]) -> ModeTable:
    """The table, each column right by itself and with the others."""
    columns: dict[str, np.ndarray] = {}
    for key in _COLUMNS:
        exact = _INSTEAD.get(key, key)
        own = exact if exact in found else key
        if own not in found:
            like = [other for other in found if other.lower().startswith(key[:4])]
            hint = f" ('{like[0]}' has another unit or none: name it {key})" if like else ""
            raise ValueError(
                f"has no column {key}{hint}; a file of modes has {', '.join(_COLUMNS)}, and "
                "shape_actuator or shape_sensor if actuator or sensor are at another point"
            )
        columns[own] = _column(own, found[own])
    columns |= {key: _column(key, found[key]) for key in _OPTIONAL if key in found}
    contact = columns["shape_contact"]
    for key, values in columns.items():
        if len(values) != len(contact):
            raise ValueError(
                f"{key} has {len(values)} values, shape_contact {len(contact)}; one row a mode"
            )
    if not len(contact):
        raise ValueError("holds no mode; it needs one row a mode below its heading")
    omega, per_mass = columns.get("omega_rad_s"), columns.get("per_modal_mass_1_kg")
    if omega is None:
        omega = 2.0 * math.pi * columns["frequency_hz"]
    falls = np.flatnonzero(np.diff(omega) < 0.0)
    if len(falls):
        first, second = omega[falls[0] : falls[0] + 2] / (2.0 * math.pi)
        raise ValueError(
            f"frequencies must rise, but mode {falls[0] + 2} has {second:g} Hz after {first:g} Hz; "
            "sort the rows"
        )
    if not contact.any():
        raise ValueError("shape_contact is 0 in every mode, so no mode can be excited there")
    return ModeTable(
        omega,
        columns["loss_factor"],
        1.0 / columns["modal_mass_kg"] if per_mass is None else per_mass,
        contact,
        columns.get("shape_actuator", contact),
        float(_column(RESIDUAL, [found[RESIDUAL]])[0]) if RESIDUAL in found else None,
        _grid(found, len(contact)) if "shape_grid" in found else None,
        columns.get("shape_sensor"),
    )


def _column(key: str, given: Any) -> np.ndarray:
    """A column as numbers that can be."""
    low, high, words = _RANGES.get(key, (-1e12, 1e12, "a number"))
    if np.ndim(given) != 1:
        raise ValueError(f"{key} has the shape {np.shape(given)}; one number a mode is needed")
    values = np.empty(len(given))
    for i, value in enumerate(given):
        try:
            values[i] = float(value)
        except (ValueError, TypeError):
            values[i] = math.nan
        if not low <= values[i] <= high:
            raise ValueError(f"{key} of mode {i + 1} is {value}; it must be {words}")
    return values


def _grid(found: Mapping[str, Any], count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The shapes on a grid."""
    for key in _GRID[:2]:
        if key not in found:
            raise ValueError(f"has shape_grid, but no {key}; a grid needs both its axes")
    x, y = (_column(key, found[key]) for key in _GRID[:2])
    shapes = np.array(found["shape_grid"], dtype=float)
    if shapes.shape != (count, len(x), len(y)):
        raise ValueError(
            f"shape_grid has the shape {shapes.shape}, not (modes, x, y) = "
            f"{(count, len(x), len(y))}"
        )
    for key, axis in (("x_m", x), ("y_m", y)):
        if len(axis) < 2 or not np.all(np.diff(axis) > 0.0):
            raise ValueError(f"{key} must rise, over at least two places")
    if not np.all(np.isfinite(shapes)):
        raise ValueError("shape_grid holds a value that is not finite. Use 0 beyond the edge")
    return x, y, shapes


def write_modes(suffix: str, table: ModeTable) -> bytes:
    """The bytes of a file that `read_modes` reads as the very same table (its grid only in NPZ)."""
    columns = {
        "frequency_hz": table.omega_rad_s / (2.0 * math.pi),
        "omega_rad_s": table.omega_rad_s,
        "loss_factor": table.loss_factor,
        "modal_mass_kg": 1.0 / table.per_modal_mass_1_kg,
        "per_modal_mass_1_kg": table.per_modal_mass_1_kg,
        "shape_contact": table.shape_contact,
        "shape_actuator": table.shape_actuator,
    }
    if table.shape_sensor is not None:
        columns["shape_sensor"] = table.shape_sensor
    residual = table.residual_flexibility_m_n
    if suffix == ".csv":
        lines = [] if residual is None else [f"# {RESIDUAL} = {residual!r}"]
        lines.append(",".join(columns))
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        lines += [",".join(map(repr, row)) for row in rows]
        return ("\n".join(lines) + "\n").encode()
    if residual is not None:
        columns[RESIDUAL] = np.array(residual)
    if table.grid is not None:
        columns |= dict(zip(_GRID, table.grid, strict=True))
    out = io.BytesIO()
    np.savez_compressed(out, **columns)  # type: ignore[arg-type]
    return out.getvalue()
