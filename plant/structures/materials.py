"""Elastic materials of spheres and structures: shipped ones and a user's, read from the same kind
of file."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources

# Speed of sound sqrt(E/rho) of a solid, m/s; outside, a number has another unit than it should.
_SLOWEST, _FASTEST = 10.0, 4e4
_FIELDS = {"young_pa": "youngs_modulus_pa", "poisson": "poisson_ratio"}  # others have one name
# Least and largest value, and both in words.
_MODULUS = (1e3, 1e13, "1e3 to 1e13 Pa")
_SHARE = (0.0, 1.0, "0 to 1")
_LIMITS = {
    "young_pa": _MODULUS,
    "density_kg_m3": (1.0, 1e5, "1 to 1e5 kg/m3"),
    "poisson": (0.0, math.nextafter(0.5, 0.0), "at least 0 and below 0.5"),
    **dict.fromkeys(("loss_factor", "restitution"), _SHARE),
    **dict.fromkeys(("yield_pa", "hardness_pa"), _MODULUS),
    "strength_spread": _SHARE,
}
_NEEDED = ("young_pa", "density_kg_m3", "poisson")


@dataclass(frozen=True)
class Material:
    """Elastic, isotropic material.

    youngs_modulus_pa, density_kg_m3; poisson_ratio, loss_factor and restitution
    (assumed local coefficient of restitution against steel) are dimensionless. `yield_pa`: yield
    strength, `hardness_pa`: indentation hardness, None where not known; `strength_spread`: by
    what share both differ from piece to piece.
    """

    youngs_modulus_pa: float
    density_kg_m3: float
    poisson_ratio: float
    loss_factor: float = 0.0
    restitution: float = 1.0
    yield_pa: float | None = None
    hardness_pa: float | None = None
    strength_spread: float = 0.2

    @cached_property
    def plane_strain_modulus_pa(self) -> float:
        """E / (1 - nu^2), Pa."""
        return self.youngs_modulus_pa / (1.0 - self.poisson_ratio * self.poisson_ratio)

    @cached_property
    def shear_modulus_pa(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)), Pa."""
        return self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))

    @cached_property
    def shear_speed_m_s(self) -> float:
        """Speed of shear waves, c_T = sqrt(G/rho), m/s."""
        return math.sqrt(self.shear_modulus_pa / self.density_kg_m3)


def material_of(where: str, table: Mapping[str, object]) -> Material:
    """A material from its table. Raises ValueError with one sentence; `where` names the table."""
    for key in table:
        if key not in _LIMITS:
            raise ValueError(
                f"{where}.{key} is not a property of a material. Use {', '.join(_LIMITS)}"
            )
    for key in _NEEDED:
        if key not in table:
            raise ValueError(f"{where}.{key} is missing; a material needs {', '.join(_NEEDED)}")
    for key, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{where}.{key} = {value!r} is not a number")
        low, high, words = _LIMITS[key]
        if not low <= value <= high:
            known = isinstance(value, float) or abs(value) < 10**20  # others have no :g
            given = f"{value:g}" if known else "a number of that size"
            raise ValueError(f"{where}.{key} = {given}: must be {words}")
    values = {_FIELDS.get(key, key): float(table[key]) for key in table}  # type: ignore[arg-type]
    found = Material(**values)
    speed = math.sqrt(found.youngs_modulus_pa / found.density_kg_m3)
    if not _SLOWEST <= speed <= _FASTEST:
        raise ValueError(
            f"{where}: young_pa = {found.youngs_modulus_pa:g} and density_kg_m3 = "
            f"{found.density_kg_m3:g} make a speed of sound of {speed:.3g} m/s, which no solid "
            "has; they are in Pa and kg/m3"
        )
    return found


def materials_of(text: str, where: str) -> dict[str, dict[str, object]]:
    """Materials of a file's text, name: table, each checked. Raises ValueError."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where} is not valid TOML: {error}") from error
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise ValueError(
                f"{where}: {name} is not a table. Write a material as [{name}] with its numbers"
            )
        material_of(f"{where}: {name}", table)
    return tables


SHIPPED = materials_of(
    (resources.files("hertzloop.plant.structures") / "materials.toml").read_text("utf-8"),
    "materials.toml",
)
MATERIALS = {name: material_of(name, table) for name, table in SHIPPED.items()}
