"""Universal files (UFF, UNV): their data sets, and the nodes and direction to take from them.

Source: https://www.ceas3.uc.edu/sdrluff, read by pyuff.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.records.readers.universal_file import data_sets

SUFFIXES = (".uff", ".unv", ".uf", ".bunv", ".ufb")
DIRECTIONS = ("x", "y", "z")
RESPONSES = {"receptance": 0, "mobility": 1, "accelerance": 2}  # time derivative of the motion
_LISTED = 12  # most nodes in a sentence


@dataclass(frozen=True)
class Points:
    """Nodes of a structure, and the direction of force and motion; None if it is not given.

    Args:
        contact: node of the contact point.
        actuator: node of the actuator.
        sensor: node of the sensor.
        direction: "x", "y" or "z".
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


def node_of(option: str, text: str) -> int:
    """Return the number of a node. Raises ModalDataError."""
    try:
        return int(text)
    except ValueError:
        raise ModalDataError(
            f"--{option} = {text}: is not the number of a node. Give a whole number."
        ) from None


def read_sets(path: Path, option: str = "--from") -> list[dict[str, Any]]:
    """Return all data sets of a universal file.

    Args:
        path: of the file.
        option: the option that gives it, for messages.

    Raises:
        ModalDataError: there is no such file, or it cannot be read.
    """
    if not path.is_file():
        raise ModalDataError(f"{option} = {path}: there is no such file. Give the path of a file.")
    try:
        found = data_sets(path)
    except Exception as error:  # pyuff raises plain exceptions for damaged files.
        raise ModalDataError(
            f"{option} = {path}: cannot be read as a universal file: {error}. Write it again."
        ) from error
    if not found:
        raise ModalDataError(
            f"{option} = {path}: holds no data set. Give a universal file (UFF, UNV)."
        )
    return found


def holds_modes(sets: Iterable[dict[str, Any]], kind: str | None, path: Path) -> bool:
    """Return whether to take the modes of a file, not its frequency responses.

    Args:
        sets: data sets of the file.
        kind: what to take, as for --kind; None for what the file holds.
        path: of the file, for messages.

    Raises:
        ModalDataError: the file holds both, and no kind is given.
    """
    types = {one["type"] if one.get("func_type", 4) == 4 else 0 for one in sets}
    if kind is None and 58 in types and types & {55, 2414}:
        raise ModalDataError(
            f"--kind: is missing, and {path} has modes and frequency responses. Give modes, "
            "accelerance, mobility or receptance."
        )
    return kind not in RESPONSES if kind else 58 not in types


def choose_direction(
    directions: Sequence[str], given: str | None, what: str, missing: list[str]
) -> str:
    """Return the direction that is given, or the only one; "" if there are several.

    Args:
        directions: those of the file.
        given: the one of --direction, if any.
        what: subject and verb of the sentence on several directions.
        missing: where that sentence is added.
    """
    if given is not None or len(directions) == 1:
        return given or directions[0]
    missing.append(
        f"--direction: is missing, and {what} in the directions {', '.join(directions)}. Give one "
        "of them."
    )
    return ""


def list_nodes(nodes: Iterable[int]) -> str:
    """Return nodes as a part of a sentence."""
    ordered = sorted(nodes)
    more = f" and {len(ordered) - _LISTED} more" if len(ordered) > _LISTED else ""
    return ", ".join(map(str, ordered[:_LISTED])) + more
