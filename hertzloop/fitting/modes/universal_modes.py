"""Modes of universal files in SI units: data sets 55 and 2414 at some nodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.file_units import FileUnits, unknown_units
from hertzloop.fitting.modes.universal_file import (
    DIRECTIONS,
    Points,
    choose_direction,
    list_nodes,
)
from hertzloop.plant.structures.mode_file import ModeTable

_NORMAL, _COMPLEX = (2,), (3, 7)  # analysis types of normal and of complex modes
_SHAPES = (0, 1, 8)  # specific data types of shapes: unknown, general, displacement
_DERIVATIVES = {11: "velocity", 12: "acceleration"}  # specific data types of other shapes
_MOST_COMPLEX = 0.3  # largest imaginary part of a shape that a real mode stands for, over its peak


@dataclass(frozen=True)
class UniversalModes:
    """Modes of a universal file.

    Args:
        table: the modes as in a mode file.
        most_complex: largest imaginary part of a shape over its largest value; 0 of real shapes.
        units: those of the file.
        direction: "x", "y" or "z".
        undamped: whether the file has no damping.
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
    missing = [unknown_units(path)] if units is None or units.is_acceleration else []
    nodes = {int(node) for mode in modes for node in mode.nodes}
    for option, node in points.named.items():
        if node not in nodes:
            raise ModalDataError(
                f"--{option} = {node}: not a node of {path}. Its nodes are {list_nodes(nodes)}."
            )
    used = list(dict.fromkeys(points.named.values()))
    shapes = np.array([[mode.at(node) for node in used] for mode in modes])  # (modes, nodes, 3)
    there = [name for i, name in enumerate(DIRECTIONS) if np.any(shapes[:, :, i])]
    direction = choose_direction(
        there or ["z"], points.direction, "the shapes of these nodes move", missing
    )
    moved = shapes[:, :, DIRECTIONS.index(direction or there[0])]
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
    real = not np.iscomplexobj(masses) and not np.iscomplexobj(moved)
    if real and np.any(masses < 0.0):
        raise ModalDataError(f"{path}: a modal mass is negative. Write the file again.")
    most_complex = 0.0
    if not real:
        moved, most_complex = _nearest_real(moved / np.sqrt(masses + 0j)[:, None], modes, path)
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


@dataclass(frozen=True)
class _Mode:
    """A mode of a file, in its units.

    Args:
        omega_rad_s: natural frequency, rad/s.
        loss_factor: loss factor.
        mass: modal mass; 0 if it is not given.
        nodes: numbers of the nodes, (nodes,).
        shapes: in x, y and z, (nodes, 3).
    """

    omega_rad_s: float
    loss_factor: float
    mass: complex | float
    nodes: np.ndarray
    shapes: np.ndarray

    @property
    def frequency_hz(self) -> float:
        return self.omega_rad_s / (2.0 * math.pi)

    def at(self, node: int) -> np.ndarray:
        """Return the shape at a node, (3,); a node without values is at rest."""
        where = np.flatnonzero(self.nodes == node)
        return self.shapes[where[0]] if len(where) else np.zeros(3)


def _mode_of(one: dict[str, Any], path: Path) -> _Mode | None:
    """Return the mode of a data set; None if the data set holds something else."""
    if one.get("analysis_type") not in (*_NORMAL, *_COMPLEX):
        return None
    if one["type"] == 55:
        shape_type = one.get("spec_data_type")
        shapes = np.stack([np.asarray(one[f"r{i}"]) for i in (1, 2, 3)], axis=1)
        keys = "freq", "modal_m", "modal_damp_vis", "modal_damp_his"
        hz, mass, viscous, hysteretic = (float(one.get(key, 0.0)) for key in keys)
        eigenvalue, modal_a = complex(one.get("eig", 0.0)), complex(one.get("modal_a", 0.0))
    elif one["type"] == 2414 and one.get("dataset_location") == 1:
        shape_type = one.get("result_type")
        shapes = np.array(one["data_at_node"], float)
        if one.get("data_type") in (5, 6):
            shapes = shapes[:, ::2] + 1j * shapes[:, 1::2]
        shapes = np.pad(shapes, ((0, 0), (0, max(0, 3 - shapes.shape[1]))))[:, :3]
        fields = [f"record12_field{i}" for i in (2, 4, 5, 6)]
        fields += [f"record13_field{i}" for i in (1, 2, 3, 4)]
        hz, mass, viscous, hysteretic, *parts = (float(one.get(key) or 0.0) for key in fields)
        eigenvalue, modal_a = complex(*parts[:2]), complex(*parts[2:])
    else:
        return None
    if shape_type not in _SHAPES:
        if shape_type in _DERIVATIVES:
            raise ModalDataError(
                f"{path}: its shapes are of {_DERIVATIVES[shape_type]}, so "
                "their scale is not that of the modal mass. Export shapes of displacement."
            )
        return None  # Stresses, for example, stand beside the shapes.
    nodes = one["node_nums"]
    if one["analysis_type"] in _NORMAL:
        return _Mode(2.0 * math.pi * hz, 2.0 * viscous + hysteretic, mass, nodes, shapes)
    omega = abs(eigenvalue)
    if not eigenvalue.imag:
        raise ModalDataError(f"{path}: a complex mode has no frequency. Remove its data set.")
    # The receptance of a real mode, 1/(m (w^2 - ...)), has the residue 1/(2 j w_d m) = 1/a.
    by_a = modal_a / (2j * eigenvalue.imag)
    return _Mode(omega, -2.0 * eigenvalue.real / omega, by_a, nodes, shapes)


def _nearest_real(
    shapes: np.ndarray, modes: Sequence[_Mode], path: Path
) -> tuple[np.ndarray, float]:
    """Return the real shapes nearest to complex ones, (modes, nodes), and their largest imaginary
    part over the largest value. Raises ModalDataError for a shape that is far from a real one."""
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
