"""Frequency responses of universal files in SI units: data sets 58 of function type 4."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.file_units import FileUnits, same_factor
from hertzloop.fitting.modes.frequency_responses import FrequencyResponses, noise_weights
from hertzloop.fitting.modes.universal_file import (
    DIRECTIONS,
    RESPONSES,
    Points,
    choose_direction,
    list_nodes,
)
from hertzloop.fitting.records.units import unit_of

_KINDS = {8: "receptance", 11: "mobility", 12: "accelerance"}  # by the specific data type
_FORCES = (9, 13)  # specific data types of a force
_KINDS_BY_UNIT = {"m": "receptance", "m/s": "mobility", "m/s^2": "accelerance", "N": "force"}
_FEWEST_LINES = 16


def responses_of_sets(
    sets: Sequence[Mapping[str, Any]],
    path: Path,
    points: Points,
    units: FileUnits | None,
    kind: str | None,
    reference: int | None,
) -> FrequencyResponses:
    """Return the frequency responses that give the modes at some nodes.

    Args:
        sets: data sets of the file.
        path: of the file, for messages.
        points: nodes of contact, actuator and sensor, and the direction.
        units: those given, or of data set 164; None where only labels can say them.
        kind: "receptance", "mobility" or "accelerance"; None: as the file says.
        reference: node of the force; None: the only one of the file.

    Raises:
        ModalDataError: a response is missing, or the file can mean several things.
    """
    straight = _straight_responses(sets, path)
    missing: list[str] = []
    directions = sorted({_axis(one["rsp_dir"]) for one in straight})
    direction = choose_direction(directions, points.direction, "the file has responses", missing)
    chosen = [one for one in straight if direction in ("", _axis(one["rsp_dir"]))]
    reference = _reference_node(chosen, reference, path, missing)
    if missing:
        for one in chosen[:1]:
            try:
                _in_si(one, path, units, kind)
            except ModalDataError as error:
                missing.append(str(error))
        raise ModalDataError(" ".join(missing))
    by_node = _by_node(chosen, reference, path)
    nodes = _used_nodes(by_node, points, reference, path)
    used = [by_node[node] for node in nodes]
    hz = np.asarray(used[0]["x"], float)
    if any(not np.array_equal(hz, one["x"]) for one in used[1:]):
        raise ModalDataError(f"{path}: its responses have different frequencies. Export one set.")
    scaled = [_in_si(one, path, units, kind) for one in used]
    orders = {order for _, order in scaled}
    if len(orders) != 1:
        raise ModalDataError(f"{path}: its responses are of several kinds. Give those of one kind.")
    values = np.array([one for one, _ in scaled])
    good = (hz > 0.0) & np.all(np.isfinite(values) & (values != 0.0), axis=0)
    if np.count_nonzero(good) < _FEWEST_LINES:
        raise ModalDataError(
            f"{path}: has fewer than {_FEWEST_LINES} lines above 0 Hz. Measure a wider band."
        )
    weights = np.array([noise_weights(one) for one in values[:, good]])
    return FrequencyResponses(
        hz[good], values[:, good], weights, orders.pop(), tuple(nodes), reference, direction
    )


def _straight_responses(sets: Sequence[Mapping[str, Any]], path: Path) -> list[Mapping[str, Any]]:
    """Return the responses along the axis of their force. Raises ModalDataError without any."""
    found = [one for one in sets if one["type"] == 58 and one.get("func_type") == 4]
    straight = [one for one in found if _axis(one["rsp_dir"]) == _axis(one["ref_dir"]) != ""]
    if not straight:
        raise ModalDataError(
            f"{path}: has no response along the direction of its force. Give responses whose "
            "directions of response and reference are x, y or z, and the same."
        )
    return straight


def _reference_node(
    chosen: list[Mapping[str, Any]], given: int | None, path: Path, missing: list[str]
) -> int:
    """Return the node of the force; add a sentence to `missing` if the file has several and none is
    given."""
    if given is not None:
        return given
    references = {int(one["ref_node"]) for one in chosen}
    if len(references) != 1:
        missing.append(
            f"--reference: is missing, and {path} has forces at the nodes "
            f"{list_nodes(references)}. Give one of them."
        )
    return min(references, default=0)


def _by_node(
    chosen: list[Mapping[str, Any]], reference: int, path: Path
) -> dict[int, Mapping[str, Any]]:
    """Return the responses to a force at the reference, by their nodes. Raises ModalDataError for
    two of one node."""
    found: dict[int, Mapping[str, Any]] = {}
    for one in chosen:
        node = int(one["rsp_node"])
        if int(one["ref_node"]) != reference:
            continue
        if node in found:
            raise ModalDataError(
                f"{path}: has several responses of node {node} to a force at node {reference}. "
                "Keep one, and give another measurement as --hold-out."
            )
        found[node] = one
    return found


def _used_nodes(
    by_node: Mapping[int, Mapping[str, Any]], points: Points, reference: int, path: Path
) -> list[int]:
    """Return the nodes whose responses give the modes, that of the force first. Raises
    ModalDataError if one is missing."""
    for option, node in points.named.items():
        if node not in by_node and not (node == reference and option == "contact"):
            raise ModalDataError(
                f"--{option} = {node}: {path} has no response of this node to a force at node "
                f"{reference}. It has those of the nodes {list_nodes(by_node)}."
            )
    nodes = list(points.named.values())
    if reference in by_node:
        nodes = [reference, *nodes]
    elif points.contact != reference:
        raise ModalDataError(
            f"--reference = {reference}: {path} has no response of this node itself, so the shapes "
            "have no scale. Measure it there, or give it as --contact."
        )
    return [node for node in dict.fromkeys(nodes) if node in by_node]


def _axis(code: int) -> str:
    """The axis of a direction code, "" of a rotation or a scalar."""
    return DIRECTIONS[abs(code) - 1] if 1 <= abs(code) <= 3 else ""


def _in_si(
    one: Mapping[str, Any], path: Path, units: FileUnits | None, kind: str | None
) -> tuple[np.ndarray, int]:
    """Return a response in SI units, positive along its axis, and its time derivative.

    Units that the user gives hold before the labels of the response.

    Args:
        one: the data set.
        path: of the file, for messages.
        units: those given, or of data set 164.
        kind: "receptance", "mobility" or "accelerance"; None: as the file says.

    Raises:
        ModalDataError: kind or units are unknown, or the file contradicts itself.
    """
    motion = _stated_unit(one, "ordinate_axis_units_lab")
    force = _stated_unit(one, "orddenom_axis_units_lab")
    by_labels = force[1] / motion[1] if motion and force else None
    by_units = units.force / units.length if units else None
    factor = by_units or by_labels
    by_type = _KINDS.get(one.get("ordinate_spec_data_type") or 0)
    known = kind or by_type or (motion[0] if motion else "")
    per_force = kind or force or one.get("orddenom_spec_data_type") in _FORCES
    missing = []
    if known not in RESPONSES or not per_force:
        missing.append(
            f"{path}: does not say whether its responses are of displacement, velocity or "
            f"acceleration per force. Give --kind {', '.join(RESPONSES)}."
        )
    if factor is None:
        missing.append(
            f"{path}: has no data set 164 and no labels of units that are known, so its units are "
            "unknown. Give --units m,N, or another length and force."
        )
    if missing or factor is None:
        raise ModalDataError(" ".join(missing))
    if not (units and units.given):
        if motion and motion[0] != known:
            raise ModalDataError(
                f"{path}: a response is of {known} by its type, but has the unit of {motion[0]}. "
                "Give --kind and --units."
            )
        if units and by_labels and not same_factor(by_labels, factor):
            raise ModalDataError(
                f"{path}: data set 164 has {units.name}, but a response has the labels "
                f"{one['ordinate_axis_units_lab'].strip()} and "
                f"{one['orddenom_axis_units_lab'].strip()}. Give --units, such as m,N or g,N."
            )
    sign = np.sign(one["rsp_dir"]) * np.sign(one["ref_dir"])
    return np.asarray(one["data"]) * factor * sign, RESPONSES[known]


def _stated_unit(one: Mapping[str, Any], key: str) -> tuple[str, float] | None:
    """Return the kind of response that the label of a unit means, "force" of a force, and how many
    such units are one SI unit; None of a label that is not known."""
    text = str(one.get(key) or "").strip().strip("()")
    if text.lower().endswith("/n"):  # The label of an ordinate may have the force below it.
        text = text[:-2].strip("()")
    unit = unit_of(text)
    if unit is None and text.isupper():
        # Some programs write all labels in capitals. MN may be milli- or meganewtons.
        small = unit_of(text.lower())
        unit = small if small is not None and small.si != "N" else None
    if unit is None or unit.si not in _KINDS_BY_UNIT:
        return None
    return _KINDS_BY_UNIT[unit.si], 1.0 / unit.size
