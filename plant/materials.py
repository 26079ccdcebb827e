"""Elastic materials of spheres and plates."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material.

    youngs_modulus_pa, density_kg_m3; poisson_ratio, loss_factor and restitution
    (assumed local coefficient of restitution against steel) are dimensionless.
    """

    youngs_modulus_pa: float
    density_kg_m3: float
    poisson_ratio: float
    loss_factor: float = 0.0
    restitution: float = 1.0

    @property
    def plane_strain_modulus_pa(self) -> float:
        """E / (1 - nu^2), Pa."""
        return self.youngs_modulus_pa / (1.0 - self.poisson_ratio**2)


# Values of the published study.
MATERIALS = {
    "steel": Material(210e9, 7800.0, 0.31),
    "aluminium": Material(7.2e10, 2700.0, 0.34, 1e-4, 0.7),
    "oak": Material(5e8, 700.0, 0.10, 5e-2, 0.6),
    "sylomer_m": Material(1.34e6, 400.0, 0.40, 16e-2, 0.2),
}
