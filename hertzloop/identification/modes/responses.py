"""Frequency responses of universal files (data set 58, function type 4) as observed responses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hertzloop.identification.modes.identify import FLEXIBILITY_M_N, ResponseRows, start_poles
from hertzloop.identification.modes.universal import (
    DIRECTIONS,
    RESPONSES,
    FileUnits,
    ModalDataError,
    Points,
    choose_direction,
    list_nodes,
)

_SENSED = {8: "receptance", 11: "mobility", 12: "accelerance"}  # specific data types
_FORCES = (9, 13)
# Labels of units: the kind of response, and how many are one SI unit.
_LABELS = {
    "m": ("receptance", 1.0),
    "mm": ("receptance", 1e3),
    "um": ("receptance", 1e6),
    "m/s": ("mobility", 1.0),
    "mm/s": ("mobility", 1e3),
    "in/s": ("mobility", 1 / 0.0254),
    "m/s^2": ("accelerance", 1.0),
    "m/s2": ("accelerance", 1.0),
    "m/s**2": ("accelerance", 1.0),
    "mm/s^2": ("accelerance", 1e3),
    "g": ("accelerance", 1 / 9.80665),
    "n": ("force", 1.0),
    "lbf": ("force", 1 / 4.4482216152605),
    "kn": ("force", 1e-3),
}
_SAME = 1e-3
_LINES = 4000  # taken evenly over the band; those around peaks come on top
_AROUND = 60  # lines on each side of a peak
_OVER_NOISE = 20.0  # of a peak
_BINS = 16  # of lines by the size of the value
_LEAST_SHARE = 1e-12  # noise of a value, squared: 1e-6
EVERY = 5  # every so many lines are held out


@dataclass(frozen=True)
class FrequencyResponses:
    """Frequency responses of several points to a force at one.

    `hz`: (lines,). `values`: per unit of force, SI units, (points, lines), and their `weights`.
    `order`: power of s from the receptance: 0, 1 or 2. `nodes`: of the points. `reference`: node of
    the force.
    """

    hz: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    order: int
    nodes: tuple[int, ...]
    reference: int
    direction: str

    @property
    def kind(self) -> str:
        """Such as "accelerance"."""
        return next(name for name, order in RESPONSES.items() if order == self.order)

    def at(self, lines: np.ndarray) -> "FrequencyResponses":
        """The same at some lines, by their numbers or a mask."""
        return replace(
            self, hz=self.hz[lines], values=self.values[:, lines], weights=self.weights[:, lines]
        )

    @property
    def drive(self) -> int | None:
        """Which of the points is that of the force; None if none is."""
        return self.nodes.index(self.reference) if self.reference in self.nodes else None

    def observed(self) -> ResponseRows:
        """As what modes are fitted to."""
        s = 2j * np.pi * self.hz
        by = s**self.order

        def basis(omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
            return by / (omega[:, None] ** 2 + s * (s + (loss * omega)[:, None]))

        x2 = (self.hz / self.hz[-1]) ** 2
        low, high = float(self.hz[0]), float(self.hz[-1])
        return ResponseRows(
            basis,
            FLEXIBILITY_M_N * np.array([by, by * x2, by * x2**2]),
            self.values,
            self.weights,
            (low, 1.1 * high),
            (high - low) / 600,
            self.drive,
        )

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (rad/s) and loss factors to begin with."""
        s = 2j * np.pi * self.hz
        count = 4 + max(map(len, map(_peaks, self.values, self.weights)))
        by = s**self.order
        return start_poles(s, self.values / by, np.abs(by) * self.weights, count)

    def thinned(self, most: int = _LINES) -> "FrequencyResponses":
        """The same at `most` lines, evenly over the band, and all around the peaks."""
        step = -(-len(self.hz) // most)
        kept = np.zeros(len(self.hz), bool)
        kept[::step] = True
        for pair in zip(self.values, self.weights, strict=True) if step > 1 else ():
            for peak in _peaks(*pair):
                kept[max(0, peak - _AROUND) : peak + _AROUND + 1] = True
        return self.at(kept)


def noise_weights(values: np.ndarray) -> np.ndarray:
    """Weights of a response, (lines,): one over the noise, which is a floor and a share of the
    value, by how far each line is from the line between its neighbours."""
    size = np.abs(values[1:-1]) ** 2
    apart = np.abs(values[:-2] - 2.0 * values[1:-1] + values[2:]) ** 2 / (6.0 * math.log(2.0))
    bins = np.array_split(np.argsort(size), _BINS)
    noise = np.array([max(np.median(apart[some]), 1e-30 * np.mean(size)) for some in bins])
    of_size = np.array([np.median(size[some]) for some in bins])
    share, floor = scipy.optimize.nnls(
        np.stack([of_size, np.ones(_BINS)], 1) / noise[:, None], np.ones(_BINS)
    )[0]
    return 1.0 / np.sqrt(max(share, _LEAST_SHARE) * np.abs(values) ** 2 + floor)


def _peaks(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Lines at which a response has a peak, of at least 1 dB and well above its noise."""
    found = scipy.signal.find_peaks(np.log10(np.abs(values)), prominence=0.05)[0]
    return np.asarray(found[np.abs(values[found]) * weights[found] > _OVER_NOISE])


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
    direction, chosen = _along_direction(straight, points, missing)
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
    if np.count_nonzero(good) < 16:
        raise ModalDataError(f"{path}: has fewer than 16 lines above 0 Hz. Measure a wider band.")
    weights = np.array([noise_weights(one) for one in values[:, good]])
    return FrequencyResponses(
        hz[good], values[:, good], weights, orders.pop(), tuple(nodes), reference, direction
    )


def _straight_responses(sets: Sequence[Mapping[str, Any]], path: Path) -> list[Mapping[str, Any]]:
    """Return the responses along the axis of their force. Raises ModalDataError without any."""
    found = [one for one in sets if one["type"] == 58 and one.get("func_type") == 4]
    both = [one for one in found if _axis(one["rsp_dir"]) and _axis(one["ref_dir"])]
    straight = [one for one in both if _axis(one["rsp_dir"]) == _axis(one["ref_dir"])]
    if not straight:
        raise ModalDataError(
            f"{path}: has no response along the direction of its force. Give responses whose "
            "directions of response and reference are x, y or z, and the same."
        )
    return straight


def _along_direction(
    straight: list[Mapping[str, Any]], points: Points, missing: list[str]
) -> tuple[str, list[Mapping[str, Any]]]:
    """Return the direction and the responses along it; all, and a sentence in `missing`, if the
    file has several directions and none is given."""
    there = sorted({_axis(one["rsp_dir"]) for one in straight})
    try:
        direction = choose_direction(there, points.direction, "the file has responses")
    except ModalDataError as error:
        missing.append(str(error))
        return "", straight
    return direction, [one for one in straight if _axis(one["rsp_dir"]) == direction]


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
    """A response in SI units, positive along its axis, and its order."""
    said, force = one.get("ordinate_spec_data_type"), one.get("orddenom_spec_data_type")
    label = _label(one, "ordinate_axis_units_lab")
    below = _label(one, "orddenom_axis_units_lab")
    known = kind or _SENSED.get(said or 0) or (label[0] if label else None)
    missing = []
    if known not in RESPONSES or (force not in _FORCES and not below and kind is None):
        missing.append(
            f"{path}: does not say whether its responses are of displacement, velocity or "
            f"acceleration per force. Give --kind {', '.join(RESPONSES)}."
        )
    if units is None and not (label and below):
        missing.append(
            f"{path}: has no data set 164 and no labels of units that are known, so its units are "
            "unknown. Give --units m,N, or another length and force."
        )
    if missing:
        raise ModalDataError(" ".join(missing))
    if units is not None and units.given:
        label = None  # what was given holds
    if label and label[0] != known:
        raise ModalDataError(
            f"{path}: a response is of {known} by its type, but has the unit of {label[0]}. Give "
            "--kind and --units."
        )
    factor = None if units is None else units.force / units.length
    if label and below:
        by_label = below[1] / label[1]
        if factor is not None and abs(by_label / factor - 1.0) > _SAME:
            assert units is not None
            raise ModalDataError(
                f"{path}: data set 164 has {units.name}, but a response has the "
                f"labels {one['ordinate_axis_units_lab'].strip()} and "
                f"{one['orddenom_axis_units_lab'].strip()}. Give --units, such as m,N or g,N."
            )
        factor = factor or by_label
    assert known is not None
    assert factor is not None
    sign = np.sign(one["rsp_dir"]) * np.sign(one["ref_dir"])
    return np.asarray(one["data"]) * factor * sign, RESPONSES[known]


def _label(one: Mapping[str, Any], key: str) -> tuple[str, float] | None:
    text = str(one.get(key) or "").strip().lower().replace("²", "^2").strip("()")
    return _LABELS.get(text.partition("/n")[0].strip("()") if text.endswith("/n") else text)
