"""Quantities that can be measured, and the names that files give them."""

from typing import NamedTuple

from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.units import name_and_unit, plain_name


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
