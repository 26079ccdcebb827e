"""What pressure makes a contact yield, by the strength of the bodies that touch.

Below a sphere yield begins beneath the surface where the pressure in the centre is 1.6 times the
yield strength (Hertz's stresses, von Mises); the mean pressure of a fully plastic dent, the
indentation hardness, is about 2.8 times it (Tabor 1951). Thornton's law knows one pressure, the
limit; impacts far beyond yield want the hardness.
"""

from dataclasses import dataclass
from functools import lru_cache

from plant.structures.materials import Material

FIRST_YIELD = 1.6  # centre pressure over yield strength
FULLY_PLASTIC = 2.8  # hardness over yield strength


@dataclass(frozen=True)
class Strength:
    """Limiting pressure of one body: `factor` times its `measure`, "hardness" or "yield strength"
    of `value_pa`; `first_yield_pa`: centre pressure at which yield begins, Pa."""

    pressure_pa: float
    factor: float
    measure: str
    value_pa: float
    first_yield_pa: float
    spread: float


def strength(material: Material) -> Strength | None:
    """Strength of a material by its hardness, or if that is not known by its yield strength; None
    where neither is."""
    hardness, yields = material.hardness_pa, material.yield_pa
    if hardness is None and yields is None:
        return None
    spread = material.strength_spread
    if hardness is None:
        assert yields is not None
        limit = FULLY_PLASTIC * yields
        return Strength(
            limit, FULLY_PLASTIC, "yield strength", yields, FIRST_YIELD * yields, spread
        )
    first = FIRST_YIELD * (hardness / FULLY_PLASTIC if yields is None else yields)
    return Strength(hardness, 1.0, "hardness", hardness, first, spread)


@lru_cache(maxsize=16)
def softer(plate: Material, sphere: Material) -> tuple[str, Strength] | None:
    """Which of the two, "plate" or "sphere", yields first, and its strength. None where the plate's
    is not known: that of the sphere alone says nothing about it."""
    of_plate, of_sphere = strength(plate), strength(sphere)
    if of_plate is None:
        return None
    if of_sphere is not None and of_sphere.pressure_pa < of_plate.pressure_pa:
        return "sphere", of_sphere
    return "plate", of_plate
