"""Files of modes, from a finite-element program, a modal test or `hertzloop scene modes`.

One row a mode, by rising frequency: frequency_hz, loss_factor, modal_mass_kg, shape_contact and,
where the actuator pushes or the sensor measures elsewhere, shape_actuator and shape_sensor; CSV
with a heading, Parquet, or NPZ with one array a column. Shapes are in any unit whose square goes
with that of the modal mass. NPZ may hold x_m, y_m and shape_grid (modes, x, y) besides, for the
picture. residual_flexibility_m_n, of all modes that are not in the file, is one number: "#
residual_flexibility_m_n = 1e-8" above the heading of a CSV, in the metadata of a Parquet file, an
array without dimensions in NPZ.

omega_rad_s and per_modal_mass_1_kg may stand in for frequency and mass: what the plant computes
with, without the rounding of 2 pi and of a division. `hertzloop scene modes` writes both.
"""

import csv
import io
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hertzloop.common.text_files import text_of

SUFFIXES = (".csv", ".parquet", ".npz")
RESIDUAL = "residual_flexibility_m_n"
_COLUMNS = ("frequency_hz", "loss_factor", "modal_mass_kg", "shape_contact")
_INSTEAD = {"frequency_hz": "omega_rad_s", "modal_mass_kg": "per_modal_mass_1_kg"}
_OPTIONAL = ("shape_actuator", "shape_sensor", *_INSTEAD.values())
_GRID = ("x_m", "y_m", "shape_grid")
_AGREE = 1e-9  # of two columns that say the same
_MOST_BYTES = 1 << 28  # unpacked
_MOST_HZ, _MOST_LOSS = 1e9, 1.0


class ModeFileError(ValueError):
    """A file of modes that is none; the message says where and what would be right."""


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
    """Modes of a file by its name and bytes. Raises ModeFileError."""
    suffix = "." + name.rpartition(".")[2].lower()
    readers = {".csv": _from_csv, ".parquet": _from_parquet, ".npz": _from_npz}
    if suffix not in readers:
        raise ModeFileError(
            f"{name} is not a file of modes; its name must end in {', '.join(SUFFIXES)}"
        )
    try:
        found = readers[suffix](name, content)
    except ModeFileError:
        raise
    except Exception as error:  # whatever a damaged file makes a library raise
        raise ModeFileError(f"{name} cannot be read as {suffix[1:]}: {error}") from error
    return _checked(name, found)


def _from_csv(name: str, content: bytes) -> dict[str, np.ndarray]:
    try:
        lines = text_of(content).splitlines()
    except ValueError as error:
        raise ModeFileError(f"{name} cannot be read: {error}") from error
    found: dict[str, np.ndarray] = {}
    rows = []
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("#"):
            key, equals, value = line.lstrip("# ").partition("=")
            if equals and key.strip() == RESIDUAL:
                found[RESIDUAL] = np.array(_number(name, number, RESIDUAL, value))
        elif line.strip():
            rows.append((number, next(csv.reader(io.StringIO(line)))))
    if not rows:
        raise ModeFileError(f"{name} is empty; a file of modes has a heading and one row a mode")
    heading = [key.strip() for key in rows[0][1]]
    for number, row in rows[1:]:
        if len(row) != len(heading):
            raise ModeFileError(
                f"{name}, line {number}: {len(row)} values under {len(heading)} headings"
            )
    for i, key in enumerate(heading):
        if key in (*_COLUMNS, *_OPTIONAL):
            found[key] = np.array([_number(name, line, key, row[i]) for line, row in rows[1:]])
        else:
            found.setdefault(key, np.zeros(0))
    return found


def _number(name: str, line: int, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModeFileError(
            f"{name}, line {line}: {key} = '{text.strip()}' is not a number"
        ) from None


def _from_parquet(name: str, content: bytes) -> dict[str, np.ndarray]:
    import pyarrow.parquet  # 0.1 s of a start, for files of this kind alone

    table = pyarrow.parquet.read_table(io.BytesIO(content))
    found = {key: np.asarray(table[key].to_numpy()) for key in table.column_names}
    kept = table.schema.metadata or {}
    if RESIDUAL.encode() in kept:
        found[RESIDUAL] = np.array(float(kept[RESIDUAL.encode()]))
    return found


def _from_npz(name: str, content: bytes) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(io.BytesIO(content)) as parts:
        size = sum(part.file_size for part in parts.infolist())
    if size > _MOST_BYTES:
        raise ModeFileError(f"{name} unpacks to {size:.2g} bytes, the most is {_MOST_BYTES:.2g}")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {key: arrays[key] for key in arrays.files}


def _checked(name: str, found: Mapping[str, np.ndarray]) -> ModeTable:
    """The table, each column right by itself and with the others."""
    _needed(name, found)
    columns: dict[str, np.ndarray] = {}
    for key in (*_COLUMNS, *_OPTIONAL):
        if key in found:
            columns[key] = _column(name, key, found[key])
    count = len(columns["shape_contact"])
    for key, values in columns.items():
        if len(values) != count:
            raise ModeFileError(
                f"{name}: {key} has {len(values)} values, shape_contact {count}; one row a mode"
            )
    if not count:
        raise ModeFileError(f"{name} holds no mode; it needs one row a mode below its heading")
    omega = _either(name, columns, "frequency_hz", lambda hz: 2.0 * math.pi * hz)
    per_mass = _either(name, columns, "modal_mass_kg", lambda mass: 1.0 / mass)
    falls = np.flatnonzero(np.diff(omega) < 0.0)
    if len(falls):
        first, second = omega[falls[0] : falls[0] + 2] / (2.0 * math.pi)
        raise ModeFileError(
            f"{name}: frequencies must rise, but mode {falls[0] + 2} has {second:g} Hz after "
            f"{first:g} Hz; sort the rows"
        )
    contact = columns["shape_contact"]
    if not contact.any():
        raise ModeFileError(
            f"{name}: shape_contact is 0 in every mode, so no mode can be excited there"
        )
    residual = None
    if RESIDUAL in found:
        residual = float(_column(name, RESIDUAL, np.atleast_1d(found[RESIDUAL]))[0])
    return ModeTable(
        omega,
        columns["loss_factor"],
        per_mass,
        contact,
        columns.get("shape_actuator", contact),
        residual,
        _grid(name, found, count),
        columns.get("shape_sensor"),
    )


def _needed(name: str, found: Mapping[str, np.ndarray]) -> None:
    for key in _COLUMNS:
        if key in found or _INSTEAD.get(key) in found:
            continue
        first = key.split("_")[0]
        like = [other for other in found if other.lower().startswith(first[:4])]
        hint = ""
        if like:
            hint = f" ('{like[0]}' has another unit or none: name it {key}, in that unit)"
        raise ModeFileError(
            f"{name} has no column {key}{hint}; a file of modes has {', '.join(_COLUMNS)}, and "
            "shape_actuator or shape_sensor if actuator or sensor are at another point"
        )


# Least and largest value that can be, and in words.
_RANGES = {
    "frequency_hz": (0.0, _MOST_HZ, "0 to 1e9 Hz"),
    "omega_rad_s": (0.0, 2.0 * math.pi * _MOST_HZ, "0 to 6e9 rad/s"),
    "loss_factor": (0.0, _MOST_LOSS, "0 to 1"),
    "modal_mass_kg": (1e-12, 1e12, "above 0, 1e-12 to 1e12 kg"),
    "per_modal_mass_1_kg": (1e-12, 1e12, "above 0, 1e-12 to 1e12 1/kg"),
    RESIDUAL: (0.0, 1.0, "0 to 1 m/N"),
}


def _column(name: str, key: str, given: np.ndarray) -> np.ndarray:
    """A column as finite numbers that can be."""
    try:
        values = np.array(given, dtype=float)
    except (ValueError, TypeError):
        raise ModeFileError(f"{name}: {key} holds what is not a number") from None
    if values.ndim != 1:
        raise ModeFileError(
            f"{name}: {key} has the shape {values.shape}; one number a mode is needed"
        )
    low, high, words = _RANGES.get(key, (-1e12, 1e12, "a number"))
    wrong = np.flatnonzero(~((values >= low) & (values <= high)))
    if len(wrong):
        raise ModeFileError(
            f"{name}: {key} of mode {wrong[0] + 1} is {values[wrong[0]]:g}; it must be {words}"
        )
    return values


def _either(
    name: str,
    columns: Mapping[str, np.ndarray],
    key: str,
    turned: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """What the plant computes with: its own column, or from the usual one; both must agree."""
    other = _INSTEAD[key]
    if other not in columns:
        return turned(columns[key])
    if key in columns:
        usual = turned(columns[key])
        apart = np.flatnonzero(np.abs(usual - columns[other]) > _AGREE * np.abs(usual))
        if len(apart):
            i = apart[0]
            raise ModeFileError(
                f"{name}: {key} = {columns[key][i]:g} and {other} = {columns[other][i]:g} of mode "
                f"{i + 1} do not say the same; has one of them the other's unit?"
            )
    return columns[other]


def _grid(
    name: str, found: Mapping[str, np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The shapes on a grid, if there are any."""
    if "shape_grid" not in found:
        return None
    for key in _GRID:
        if key not in found:
            raise ModeFileError(f"{name} has shape_grid, but no {key}; a grid needs both its axes")
    x, y = (_column(name, key, found[key]) for key in _GRID[:2])
    shapes = np.array(found["shape_grid"], dtype=float)
    if shapes.shape != (count, len(x), len(y)):
        raise ModeFileError(
            f"{name}: shape_grid has the shape {shapes.shape}, not (modes, x, y) = "
            f"{(count, len(x), len(y))}"
        )
    for key, axis in (("x_m", x), ("y_m", y)):
        if len(axis) < 2 or not np.all(np.diff(axis) > 0.0):
            raise ModeFileError(f"{name}: {key} must rise, over at least two places")
    if not np.all(np.isfinite(shapes)):
        raise ModeFileError(
            f"{name}: shape_grid holds a value that is not finite. Use 0 beyond the edge"
        )
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
    out = io.BytesIO()
    if suffix == ".csv":
        lines = [] if residual is None else [f"# {RESIDUAL} = {residual!r}"]
        lines.append(",".join(columns))
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        lines += [",".join(map(repr, row)) for row in rows]
        return ("\n".join(lines) + "\n").encode()
    if suffix == ".parquet":
        import pyarrow as pa  # as above
        import pyarrow.parquet

        kept = {} if residual is None else {RESIDUAL: repr(residual)}
        pyarrow.parquet.write_table(pa.table(columns).replace_schema_metadata(kept), out)
        return out.getvalue()
    if residual is not None:
        columns[RESIDUAL] = np.array(residual)
    if table.grid is not None:
        columns |= dict(zip(_GRID, table.grid, strict=True))
    np.savez_compressed(out, **columns)  # type: ignore[arg-type]
    return out.getvalue()
