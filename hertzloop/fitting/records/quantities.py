"""Quantities that can be measured, and the names and units that files give them.

Example: "Force [kN]", "Force (kN)" and "force_kn" all end in kN, which is 1000 N.
"""

import re
from typing import NamedTuple

from hertzloop.fitting.errors import RecordError


class UnitSize(NamedTuple):
    """The SI unit of a quantity, and the size of a unit in it."""

    si: str
    size: float


UNITS = {
    "N": UnitSize("N", 1.0),
    "kN": UnitSize("N", 1e3),
    "mN": UnitSize("N", 1e-3),
    "lbf": UnitSize("N", 4.4482216152605),
    "m/s": UnitSize("m/s", 1.0),
    "mm/s": UnitSize("m/s", 1e-3),
    "um/s": UnitSize("m/s", 1e-6),
    "m/s^2": UnitSize("m/s^2", 1.0),
    "mm/s^2": UnitSize("m/s^2", 1e-3),
    "g": UnitSize("m/s^2", 9.80665),
    "m": UnitSize("m", 1.0),
    "mm": UnitSize("m", 1e-3),
    "um": UnitSize("m", 1e-6),
    "nm": UnitSize("m", 1e-9),
    "s": UnitSize("s", 1.0),
    "ms": UnitSize("s", 1e-3),
    "us": UnitSize("s", 1e-6),
    "ns": UnitSize("s", 1e-9),
    "V": UnitSize("V", 1.0),
    "mV": UnitSize("V", 1e-3),
}


def units_of(si: str) -> list[str]:
    """The symbols of the units of one SI unit."""
    return [symbol for symbol, unit in UNITS.items() if unit.si == si]


def symbol_of(text: str) -> str:
    """Return a unit with the signs of this table: "µm/s²" and "um/s2" are "um/s^2"."""
    plain = re.sub("[\u00b5\u03bc]", "u", text.strip()).replace("\u00b2", "^2")
    return plain.replace("s2", "s^2")


def plain_name(text: str) -> str:
    """Return a name in small letters, with an underscore for all other signs."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def name_and_unit(heading: str) -> tuple[str, str]:
    """Split a heading into its plain name and the unit at its end, "" if it ends in none.

    A unit after an underscore has the letters of its symbol, or small ones: `force_kN`,
    `force_kn`. `force_MN` ends in no unit, since it may mean mega- or millinewton.
    """
    found = re.fullmatch(r"(.+?)[\s_]*[\[(]([^\[\]()]+)[\])]", heading.strip())
    if found:
        return plain_name(found[1]), symbol_of(found[2])
    for symbol in sorted(UNITS, key=len, reverse=True):
        ending = "_" + symbol.replace("/", "_").replace("^", "")
        if heading.endswith((ending, ending.lower())):
            return plain_name(heading[: -len(ending)]), symbol
    return plain_name(heading), ""


class Quantity(NamedTuple):
    """A quantity that can be measured: SI unit, meaning, and the `sensors.quantity` of a scene that
    samples it, "" if none does."""

    unit: str
    meaning: str
    sensed: str


QUANTITIES = {
    "contact_force": Quantity("N", "contact force, up on the striker", "contact_force"),
    "v_p": Quantity("m/s", "plate velocity, up positive", "v_p"),
    "acceleration": Quantity("m/s^2", "plate acceleration, up positive", "acceleration"),
    "actuator_force": Quantity("N", "force of the actuator, up on the plate", ""),
    "xi_p": Quantity("m", "plate displacement, up positive", ""),
    "xi": Quantity("m", "gap between striker and plate", "xi"),
    "xi_s": Quantity("m", "striker's lowest point", ""),
}

NAMES = {q: q for q in QUANTITIES} | {
    "force": "contact_force",
    "f_c": "contact_force",
    "velocity": "v_p",
    "plate_velocity": "v_p",
    "accel": "acceleration",
    "plate_acceleration": "acceleration",
    "displacement": "xi_p",
    "plate_displacement": "xi_p",
    "gap": "xi",
    "sphere_position": "xi_s",
    "f_a": "actuator_force",
}

GAP_QUANTITIES = ("xi", "xi_s")  # distances from the plate, which are not zero at rest

PLATE_QUANTITIES = ("v_p", "acceleration", "xi_p")  # quantities with a measuring point


def split_heading(heading: str) -> tuple[str, str]:
    """Return the plain name and the unit of a heading; the name of a quantity ends in no unit."""
    plain = plain_name(heading)
    return (plain, "") if plain in NAMES else name_and_unit(heading)


def quantity_of(heading: str) -> str | None:
    """The quantity that a heading means, such as `v_p_mm_s` or "Force [kN]"; None for none."""
    return NAMES.get(split_heading(heading)[0])


def known_quantity(quantity: str | None, name: str) -> str:
    """Return a quantity. Raises RecordError if it is not one of `QUANTITIES`."""
    if quantity not in QUANTITIES:
        raise RecordError(
            f"record.quantity = '{quantity}': not known in {name}. Give one of "
            f"{', '.join(QUANTITIES)}."
        )
    return quantity
