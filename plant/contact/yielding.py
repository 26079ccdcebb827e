"""A contact that yields (Thornton 1997, J. Appl. Mech. 64, 383): its curves in closed form.

Up to a penetration delta_y the contact is Hertz's; beyond it the pressure is limited and the
force rises on a line. Coming back, and whenever the same spot is hit again, it follows a Hertz
curve of a flatter dent, down to a dent that stays; past the deepest penetration so far it goes on
along the line.

Below a sphere yield begins beneath the surface where the pressure in the centre is 1.6 times the
yield strength (Hertz's stresses, von Mises); the mean pressure of a fully plastic dent, the
indentation hardness, is about 2.8 times it (Tabor 1951). Thornton's law knows one pressure, the
limit; impacts far beyond yield want the hardness.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.hertz import Contact, Limit
from hertzloop.plant.structures.materials import Material


class Yielding(NamedTuple):
    """Penetration (m), force (N) and energy (J) of first yield, and the line's rise (N/m)."""

    delta_m: float
    force_n: float
    rise_n_m: float
    energy_j: float


def yielding(limit: Limit, stiffness: float) -> Yielding:
    """Coefficients of the law on a Hertz contact of `stiffness` (N/m^1.5)."""
    radius = limit.radius_m
    modulus = 0.75 * stiffness / math.sqrt(radius)
    delta = radius * (math.pi * limit.pressure_pa / (2.0 * modulus)) ** 2
    return Yielding(
        delta_m=delta,
        force_n=stiffness * delta**1.5,
        rise_n_m=math.pi * limit.pressure_pa * radius,
        energy_j=0.4 * stiffness * delta**2.5,
    )


def dent_m(law: Yielding, stiffness: float, deepest_m: np.ndarray) -> np.ndarray:
    """Dent left by the deepest penetrations `deepest_m` so far (m, any shape)."""
    deepest = np.maximum(deepest_m, law.delta_m)
    load = law.force_n + law.rise_n_m * (deepest - law.delta_m)
    dent = deepest - (load / _reloading(stiffness, deepest, load)) ** (2.0 / 3.0)
    return np.asarray(np.where(deepest > law.delta_m, dent, 0.0))


def dent_now_m(contact: Contact, deepest_m: float) -> float:
    """Dent left by the deepest penetration so far, m; zero of an elastic contact."""
    dents = dents_m(contact, np.array([deepest_m]))
    return 0.0 if dents is None else float(dents[0])


def yield_depth_m(contact: Contact) -> float:
    """Penetration at which a contact begins to yield, m; inf of an elastic one."""
    if contact.limit is None:
        return math.inf
    return float(yielding(contact.limit, contact.stiffness).delta_m)


def deepest_rigid_m(contact: Contact, energy_j: float) -> float:
    """Penetration at which a contact on a rigid plate has taken `energy_j`, m."""
    hertz = float((2.5 * energy_j / contact.stiffness) ** 0.4)
    if contact.limit is None:
        return hertz
    law = yielding(contact.limit, contact.stiffness)
    beyond = energy_j - law.energy_j  # = F_y x + rise x^2/2 with x = p - delta_y
    if beyond <= 0.0:
        return hertz
    root = math.sqrt(law.force_n**2 + 2.0 * law.rise_n_m * beyond)
    return float(law.delta_m + (root - law.force_n) / law.rise_n_m)


def force_n(
    law: Yielding, stiffness: float, penetration_m: np.ndarray, deepest_m: np.ndarray
) -> np.ndarray:
    """Force at penetrations of at most `deepest_m`, the deepest ones so far (m, same shape)."""
    deepest = np.maximum(deepest_m, law.delta_m)
    load = law.force_n + law.rise_n_m * (deepest - law.delta_m)
    above = np.maximum(penetration_m - dent_m(law, stiffness, deepest), 0.0)
    return np.asarray(_reloading(stiffness, deepest, load) * above**1.5)


def dents_m(contact: Contact, deepest_m: np.ndarray) -> np.ndarray | None:
    """Dent at every step by the deepest penetrations so far (m); None of an elastic contact."""
    if contact.limit is None:
        return None
    return dent_m(yielding(contact.limit, contact.stiffness), contact.stiffness, deepest_m)


def above_dent_m(contact: Contact, xi_m: np.ndarray, deepest_m: np.ndarray) -> np.ndarray:
    """Gap above the dent that there is: below zero is contact, as everywhere; m."""
    dents = dents_m(contact, deepest_m)
    return xi_m if dents is None else np.asarray(xi_m + dents)


def elastic_n(contact: Contact, penetration_m: np.ndarray, deepest_m: np.ndarray) -> np.ndarray:
    """Contact force without damping at penetrations below or above zero, N."""
    if contact.limit is None:
        return np.asarray(contact.stiffness * np.maximum(penetration_m, 0.0) ** 1.5)
    law = yielding(contact.limit, contact.stiffness)
    return force_n(law, contact.stiffness, penetration_m, deepest_m)


def _reloading(stiffness: float, deepest: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Stiffness of the dent's Hertz curve, N/m^1.5."""
    return np.asarray(stiffness * np.sqrt(stiffness * deepest**1.5 / load))


FIRST_YIELD = 1.6  # centre pressure over yield strength
FULLY_PLASTIC = 2.8  # hardness over yield strength


@dataclass(frozen=True)
class YieldPressure:
    """Limiting pressure of one body: `factor` times its `measure`, "hardness" or "yield strength"
    of `value_pa`; `first_yield_pa`: centre pressure at which yield begins, Pa."""

    pressure_pa: float
    factor: float
    measure: str
    value_pa: float
    first_yield_pa: float
    spread: float


def strength(material: Material) -> YieldPressure | None:
    """Strength of a material by its hardness, or if that is not known by its yield strength; None
    where neither is."""
    hardness, yields = material.hardness_pa, material.yield_pa
    if hardness is None and yields is None:
        return None
    spread = material.strength_spread
    if hardness is None:
        assert yields is not None
        limit = FULLY_PLASTIC * yields
        return YieldPressure(
            limit, FULLY_PLASTIC, "yield strength", yields, FIRST_YIELD * yields, spread
        )
    first = FIRST_YIELD * (hardness / FULLY_PLASTIC if yields is None else yields)
    return YieldPressure(hardness, 1.0, "hardness", hardness, first, spread)


@lru_cache(maxsize=16)
def softer(plate: Material, sphere: Material) -> tuple[str, YieldPressure] | None:
    """Which of the two, "plate" or "sphere", yields first, and its strength. None where the plate's
    is not known: that of the sphere alone says nothing about it."""
    of_plate, of_sphere = strength(plate), strength(sphere)
    if of_plate is None:
        return None
    if of_sphere is not None and of_sphere.pressure_pa < of_plate.pressure_pa:
        return "sphere", of_sphere
    return "plate", of_plate
