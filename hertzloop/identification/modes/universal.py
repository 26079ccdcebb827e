"""Modes of universal files (UFF, UNV), in SI units: data sets 55 and 2414, units of data set 164.

Source: https://www.ceas3.uc.edu/sdrluff, read by pyuff.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.plant.structures.mode_file import ModeTable

SUFFIXES = (".uff", ".unv", ".uf", ".bunv", ".ufb")
DIRECTIONS = ("x", "y", "z")
RESPONSES = {"receptance": 0, "mobility": 1, "accelerance": 2}  # power of s from the first
_SHOWN = 12  # of many nodes in a sentence

# Units of length and force: how many of them are one metre, one newton. Names as for `--units`; g
# is that of acceleration, in accelerances.
LENGTHS = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254, "ft": 1 / 0.3048, "g": 1 / 9.80665}
FORCES = {
    "N": 1.0,
    "cN": 1e2,
    "mN": 1e3,
    "kN": 1e-3,
    "lbf": 1 / 4.4482216152605,
    "kgf": 1 / 9.80665,
    "pdl": 1 / 0.138254954376,
}
# What the codes of data set 164 mean; 9 is defined by its factors alone.
_CODES = {
    1: ("m", "N"),
    2: ("ft", "lbf"),
    3: ("m", "kgf"),
    4: ("ft", "pdl"),
    5: ("mm", "mN"),
    6: ("cm", "cN"),
    7: ("in", "lbf"),
    8: ("mm", "kgf"),
    10: ("mm", "N"),
}
_SAME_FACTOR = 1e-3
_NORMAL, _COMPLEX = (2,), (3, 7)  # analysis types: normal modes, complex ones
_OF_SHAPES = (0, 1, 8)  # specific data types: unknown, general, displacement
_MOST_COMPLEX = 0.3  # imaginary part of a shape, beyond which no real mode stands for it


class ModalDataError(ValueError):
    """A file cannot become modes. The message names the field, its value and the remedy."""

    exit_status = 2


@dataclass(frozen=True)
class FileUnits:
    """Units of a file: how many of its units one metre and one newton are, their name, and whether
    they were given."""

    length: float
    force: float
    name: str
    given: bool = False

    @property
    def mass_kg(self) -> float:
        """One unit of mass, kg: that which one unit of force gives one unit of length per s^2."""
        return self.length / self.force


@dataclass(frozen=True)
class Points:
    """Nodes of the structure, and the direction of force and motion; None is not given.

    `contact`, `actuator`, `sensor`: node numbers. `direction`: "x", "y" or "z".
    """

    contact: int
    actuator: int | None = None
    sensor: int | None = None
    direction: str | None = None

    @property
    def named(self) -> dict[str, int]:
        """The nodes by option."""
        nodes = {"contact": self.contact, "actuator": self.actuator, "sensor": self.sensor}
        return {option: node for option, node in nodes.items() if node is not None}


def read_sets(path: Path, option: str = "--from") -> list[dict[str, Any]]:
    """Return all data sets of a universal file, which `option` gives. Raises ModalDataError."""
    import pyuff  # of an extra

    if not path.is_file():
        raise ModalDataError(f"{option} = {path}: there is no such file. Give the path of a file.")
    try:
        found = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # pyuff raises plain exceptions for whatever is damaged
        raise ModalDataError(
            f"{option} = {path}: cannot be read as a universal file: {error}. Write it again."
        ) from error
    found = found if isinstance(found, list) else [found]
    if not found:
        raise ModalDataError(
            f"{option} = {path}: holds no data set. Give a universal file (UFF, UNV)."
        )
    return found


def units_given(text: str) -> FileUnits:
    """Return the units of a text such as "mm,N". Raises ModalDataError."""
    length, comma, force = (part.strip() for part in text.partition(","))
    if not comma or length not in LENGTHS or force not in FORCES:
        raise ModalDataError(
            f"--units = {text}: must be a length and a force, such as m,N. Use one of "
            f"{', '.join(LENGTHS)}, and one of {', '.join(FORCES)}."
        )
    return FileUnits(LENGTHS[length], FORCES[force], f"{length} and {force}", given=True)


def units_of(sets: Iterable[dict[str, Any]], path: Path, given: str | None) -> FileUnits | None:
    """Return the units of a file: those `given`, or those of its data set 164; None without one.

    Raises:
        ModalDataError: the file says two different things.
    """
    if given is not None:
        return units_given(given)
    stated = [one for one in sets if one["type"] == 164]
    if not stated:
        return None
    found = {(one["units_code"], one["length"], one["force"]) for one in stated}
    code, length, force = found.pop()
    if found or not (length > 0.0 and force > 0.0):
        raise ModalDataError(f"{path}: its data sets 164 do not give one unit. Give --units m,N.")
    if code not in _CODES:
        return FileUnits(length, force, f"1/{length:g} m and 1/{force:g} N")
    names = _CODES[code]
    factors = LENGTHS[names[0]], FORCES[names[1]]
    if max(abs(length / factors[0] - 1.0), abs(force / factors[1] - 1.0)) > _SAME_FACTOR:
        raise ModalDataError(
            f"{path}: its data set 164 has the code {code} of {names[0]} and {names[1]}, but the "
            f"factors {length:g} and {force:g} of other units. Give --units {','.join(names)}, or "
            "another length and force."
        )
    return FileUnits(*factors, " and ".join(names))


def holds_modes(sets: Iterable[dict[str, Any]], kind: str | None, path: Path) -> bool:
    """Return whether to take the modes of a file, not its frequency responses. Raises
    ModalDataError for a file with both, unless a kind is asked for."""
    types = {one["type"] if one.get("func_type", 4) == 4 else 0 for one in sets}
    if kind is None and 58 in types and types & {55, 2414}:
        raise ModalDataError(
            f"--kind: is missing, and {path} has modes and frequency responses. Give modes, "
            "accelerance, mobility or receptance."
        )
    return kind not in RESPONSES if kind else 58 not in types


def choose_direction(directions: Sequence[str], asked: str | None, what: str) -> str:
    """Return the direction asked for, or the only one. Raises ModalDataError."""
    if asked is not None:
        return asked
    if len(directions) == 1:
        return directions[0]
    raise ModalDataError(
        f"--direction: is missing, and {what} in the directions {', '.join(directions)}. Give one "
        "of them."
    )


@dataclass(frozen=True)
class UniversalModes:
    """Modes of a universal file.

    `table`: as a mode file has them. `most_complex`: largest imaginary part of a shape over its
    largest value, 0 of real ones. `units`: those of the file. `direction`: "x", "y" or "z".
    `undamped`: whether the file has no damping.
    """

    table: ModeTable
    most_complex: float
    units: FileUnits
    direction: str
    undamped: bool


def modes_of_sets(
    sets: Sequence[dict[str, Any]],
    path: Path,
    points: Points,
    units: FileUnits | None,
    *,
    unit_mass: bool = False,
    loss_factor: float | None = None,
) -> UniversalModes:
    """Return the modes of data sets 55 and 2414 at some nodes.

    Args:
        sets: data sets of the file.
        path: of the file, for messages.
        points: nodes of contact, actuator and sensor, and the direction.
        units: of the file; None if they are unknown.
        unit_mass: the shapes are mass-normalised, whatever modal mass the file gives.
        loss_factor: loss factor of every mode, where the file has none.

    Raises:
        ModalDataError: a node or a mass is missing, or a shape is far from a real one.
    """
    modes = sorted(
        (found for one in sets if (found := _mode_of(one, path)) is not None),
        key=lambda mode: mode.omega_rad_s,
    )
    if not modes:
        raise ModalDataError(
            f"{path}: holds no modes at nodes (data set 55 or 2414). Give a file with modes, or "
            "with frequency responses (data set 58)."
        )
    missing = [unknown_units(path)] if units is None or units.length == LENGTHS["g"] else []
    nodes = {int(node) for mode in modes for node in mode.nodes}
    for option, node in points.named.items():
        if node not in nodes:
            raise ModalDataError(
                f"--{option} = {node}: not a node of {path}. Its nodes are {list_nodes(nodes)}."
            )
    used = list(dict.fromkeys(points.named.values()))
    shapes = np.array([[mode.at(node) for node in used] for mode in modes])  # (modes, nodes, 3)
    there = [name for i, name in enumerate(DIRECTIONS) if np.any(shapes[:, :, i])]
    try:
        direction = choose_direction(
            there or ["z"], points.direction, "the shapes of these nodes move"
        )
    except ModalDataError as error:
        direction = there[0]
        missing.append(str(error))
    moved = shapes[:, :, DIRECTIONS.index(direction)]
    masses = np.array([1.0 if unit_mass else mode.mass for mode in modes])
    wrong = np.flatnonzero(~(np.abs(masses) > 0.0))
    if len(wrong):
        missing.append(
            f"{path}: the modal mass of mode {wrong[0] + 1} ({modes[wrong[0]].frequency_hz:.5g} Hz)"
            " is 0, so the scale of its shape is unknown. Add --unit-modal-mass if the shapes are "
            "mass-normalised."
        )
    if missing or units is None:
        raise ModalDataError(" ".join(missing))
    plain = not np.iscomplexobj(masses) and not np.iscomplexobj(moved)
    if plain and np.any(masses < 0.0):
        raise ModalDataError(f"{path}: a modal mass is negative. Write the file again.")
    most_complex = 0.0
    if not plain:
        moved, most_complex = _real(moved / np.sqrt(masses + 0j)[:, None], modes, path)
        masses = np.ones(len(modes))
    loss = _loss_factors(modes, loss_factor, path)
    by_node = dict(zip(used, moved.T, strict=True))
    table = ModeTable(
        np.array([mode.omega_rad_s for mode in modes]),
        loss,
        1.0 / (np.real(masses) * units.mass_kg),
        by_node[points.contact],
        by_node[points.contact if points.actuator is None else points.actuator],
        shape_sensor=None if points.sensor is None else by_node[points.sensor],
    )
    undamped = loss_factor is None and not np.any(loss)
    return UniversalModes(table, most_complex, units, direction, undamped)


def _loss_factors(modes: Sequence["_Mode"], given: float | None, path: Path) -> np.ndarray:
    """Return the loss factors of modes, (modes,): those of the file, or the one that is given for a
    file without any. Raises ModalDataError if there are both."""
    found = np.array([mode.loss_factor for mode in modes])
    if given is None:
        return found
    if np.any(found):
        raise ModalDataError(
            f"--loss-factor = {given:g}: {path} has a damping for each mode. Leave the option out."
        )
    return np.full(len(modes), given)


def unknown_units(path: Path) -> str:
    """Say that the units of a file are unknown."""
    return (
        f"{path}: has no data set 164, so its units are unknown. Give --units m,N, or another "
        "length and force."
    )


def list_nodes(nodes: Iterable[int]) -> str:
    """Nodes as a sentence has them."""
    ordered = sorted(nodes)
    more = f" and {len(ordered) - _SHOWN} more" if len(ordered) > _SHOWN else ""
    return ", ".join(map(str, ordered[:_SHOWN])) + more


@dataclass(frozen=True)
class _Mode:
    """A mode of a file, in its units: `mass` 0 is not given; `shapes` (nodes, 3)."""

    omega_rad_s: float
    loss_factor: float
    mass: complex | float
    nodes: np.ndarray
    shapes: np.ndarray

    @property
    def frequency_hz(self) -> float:
        return self.omega_rad_s / (2.0 * math.pi)

    def at(self, node: int) -> np.ndarray:
        """The shape at a node; a node without a record is at rest."""
        where = np.flatnonzero(self.nodes == node)
        return self.shapes[where[0]] if len(where) else np.zeros(3)


def _mode_of(one: dict[str, Any], path: Path) -> _Mode | None:
    """The mode of a data set; None of one that holds something else."""
    if one["type"] == 55 and one.get("analysis_type") in (*_NORMAL, *_COMPLEX):
        said, nodes = one.get("spec_data_type"), one["node_nums"]
        shapes = np.stack([np.asarray(one[f"r{i}"]) for i in (1, 2, 3)], axis=1)
        numbers = (
            one.get("freq", 0.0),
            one.get("modal_m", 0.0),
            one.get("modal_damp_vis", 0.0),
            one.get("modal_damp_his", 0.0),
        )
        eigenvalue, modal_a = complex(one.get("eig", 0.0)), complex(one.get("modal_a", 0.0))
    elif (
        one["type"] == 2414
        and one.get("analysis_type") in (*_NORMAL, *_COMPLEX)
        and one.get("dataset_location") == 1
    ):
        said, nodes = one.get("result_type"), one["node_nums"]
        shapes = np.array(one["data_at_node"], float)
        if one.get("data_type") in (5, 6):
            shapes = shapes[:, ::2] + 1j * shapes[:, 1::2]
        shapes = np.pad(shapes, ((0, 0), (0, max(0, 3 - shapes.shape[1]))))[:, :3]
        fields = [float(one.get(f"record12_field{i}") or 0.0) for i in range(2, 7)]
        numbers = fields[0], fields[2], fields[3], fields[4]
        more = [float(one.get(f"record13_field{i}") or 0.0) for i in range(1, 5)]
        eigenvalue, modal_a = complex(*more[:2]), complex(*more[2:])
    else:
        return None
    if said not in _OF_SHAPES:
        if said in (11, 12):
            raise ModalDataError(
                f"{path}: its shapes are of {'velocity' if said == 11 else 'acceleration'}, so "
                "their scale is not that of the modal mass. Export shapes of displacement."
            )
        return None  # stresses and the like stand beside the shapes
    hz, mass, viscous, hysteretic = (float(number) for number in numbers)
    if one["analysis_type"] in _NORMAL:
        return _Mode(2.0 * math.pi * hz, 2.0 * viscous + hysteretic, mass, nodes, shapes)
    omega = abs(eigenvalue)
    if not eigenvalue.imag:
        raise ModalDataError(f"{path}: a complex mode has no frequency. Remove its data set.")
    # The receptance of a real mode, 1/(m (w^2 - ...)), has the residue 1/(2 j w_d m) = 1/a.
    by_a = modal_a / (2j * eigenvalue.imag)
    return _Mode(omega, -2.0 * eigenvalue.real / omega, by_a, nodes, shapes)


def _real(shapes: np.ndarray, modes: Sequence[_Mode], path: Path) -> tuple[np.ndarray, float]:
    """The real shapes nearest to complex ones, (modes, nodes), and how far the farthest is."""
    turned = shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=1)))[:, None]
    largest = np.max(np.abs(turned), axis=1)
    apart = np.max(np.abs(turned.imag), axis=1) / np.where(largest > 0.0, largest, 1.0)
    worst = int(np.argmax(apart))
    if apart[worst] > _MOST_COMPLEX:
        raise ModalDataError(
            f"{path}: the shape of mode {worst + 1} ({modes[worst].frequency_hz:.5g} Hz) is far "
            f"from a real one: its imaginary part is {100 * apart[worst]:.0f} % of its largest "
            f"value, the most is {100 * _MOST_COMPLEX:.0f} %. Remove the mode, or export normal "
            "modes."
        )
    return np.real(turned), float(apart[worst])


def node_of(option: str, text: str) -> int:
    """Return the number of a node. Raises ModalDataError."""
    try:
        return int(text)
    except ValueError:
        raise ModalDataError(
            f"--{option} = {text}: is not the number of a node. Give a whole number."
        ) from None
