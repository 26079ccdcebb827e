"""Units of length and force of universal files: given by the user, or by data set 164."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.records.units import unit_of

# Names for --units. An accelerance may be in g, which stands in the place of a length.
LENGTHS = ("m", "cm", "mm", "in", "ft", "g")
FORCES = ("N", "cN", "mN", "kN", "lbf", "kgf", "pdl")
# Units of the codes of data set 164. Code 9 is defined by its factors alone.
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
_SAME = 1e-3  # largest relative difference of two factors of one unit


@dataclass(frozen=True)
class FileUnits:
    """Units of a universal file.

    Args:
        length: how many of its units of length are one metre.
        force: how many of its units of force are one newton.
        name: both in words.
        given: whether the user gave them.
    """

    length: float
    force: float
    name: str
    given: bool = False

    @property
    def mass_kg(self) -> float:
        """Unit of mass, kg: one unit of force accelerates it by one unit of length per s^2."""
        return self.length / self.force

    @property
    def is_acceleration(self) -> bool:
        """Whether the unit of length is g, which is one of acceleration."""
        return self.length == _per_si_unit("g")


def same_factor(one: float, other: float) -> bool:
    """Return whether two factors mean one unit."""
    return abs(one / other - 1.0) <= _SAME


def units_given(text: str) -> FileUnits:
    """Return the units of a text such as "mm,N". Raises ModalDataError."""
    length, comma, force = (part.strip() for part in text.partition(","))
    if not comma or length not in LENGTHS or force not in FORCES:
        raise ModalDataError(
            f"--units = {text}: must be a length and a force, such as m,N. Use one of "
            f"{', '.join(LENGTHS)}, and one of {', '.join(FORCES)}."
        )
    return FileUnits(_per_si_unit(length), _per_si_unit(force), f"{length} and {force}", given=True)


def units_of(sets: Iterable[dict[str, Any]], path: Path, given: str | None) -> FileUnits | None:
    """Return the units of a file: those that are given, or those of its data set 164.

    Args:
        sets: data sets of the file.
        path: of the file, for messages.
        given: text of --units; None if the option is missing.

    Returns:
        The units; None without the option and the data set.

    Raises:
        ModalDataError: the text is no unit, or the file contradicts itself.
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
    factors = _per_si_unit(names[0]), _per_si_unit(names[1])
    if not (same_factor(length, factors[0]) and same_factor(force, factors[1])):
        raise ModalDataError(
            f"{path}: its data set 164 has the code {code} of {names[0]} and {names[1]}, but the "
            f"factors {length:g} and {force:g} of other units. Give --units {','.join(names)}, or "
            "another length and force."
        )
    return FileUnits(*factors, " and ".join(names))


def _per_si_unit(name: str) -> float:
    """Return how many of a known unit are one unit of the SI."""
    unit = unit_of(name)
    assert unit is not None
    return 1.0 / unit.size


def unknown_units(path: Path) -> str:
    """Say that the units of a file are unknown."""
    return (
        f"{path}: has no data set 164, so its units are unknown. Give --units m,N, or another "
        "length and force."
    )
