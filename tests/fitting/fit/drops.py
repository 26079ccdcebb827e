"""A drop on a simply supported plate by other means: steps of 50 ns, all modes to 2 MHz.

The modes above are a spring. `Drop` shares nothing with the package: materials, modes and
contact are written out here.
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.scene.setup import Setup, load

GRAVITY = 9.81
# Young's modulus (Pa), density (kg/m^3) and Poisson's ratio.
BALLS = {
    "steel": (210e9, 7800.0, 0.31),
    "glass": (64e9, 2500.0, 0.22),
    "tungsten carbide": (600e9, 15000.0, 0.22),
    "alumina": (370e9, 3900.0, 0.22),
}
PLATES = {
    "aluminium": (7.2e10, 2700.0, 0.34),
    "steel": (2.0e11, 7850.0, 0.29),
    "glass": (6.4e10, 2480.0, 0.23),
    "brass": (1.0e11, 8500.0, 0.33),
}


@dataclass(frozen=True)
class Drop:
    """A drop with an elastic contact; SI units."""

    radius: float = 3e-3
    height: float = 0.05
    thickness: float = 3e-3
    loss_factor: float = 1e-3
    size: float = 0.5
    of_ball: tuple[float, float, float] = (210e9, 7800.0, 0.31)
    of_plate: tuple[float, float, float] = (7.2e10, 2700.0, 0.34)

    def simulate(self, duration: float, step: float = 50e-9, highest: float = 2e6):
        """Times after the touch (s), contact force (N) and plate velocity (m/s, up)."""
        e1, rho1, nu1 = self.of_ball
        e2, rho2, nu2 = self.of_plate
        star = 1.0 / ((1 - nu1**2) / e1 + (1 - nu2**2) / e2)
        s = 4.0 / 3.0 * star * math.sqrt(self.radius)
        mass = 4.0 / 3.0 * math.pi * self.radius**3 * rho1
        bending = e2 * self.thickness**3 / 12.0 / (1 - nu2**2)
        per_area = rho2 * self.thickness
        shortest = math.sqrt(2 * math.pi * highest * math.sqrt(per_area / bending))
        most = int(self.size / math.pi * shortest) + 1
        m, n = np.meshgrid(np.arange(1, most, 2), np.arange(1, most, 2))
        omega = math.sqrt(bending / per_area) * (math.pi / self.size) ** 2 * (m**2 + n**2)
        omega = np.sort(omega[omega < 2 * math.pi * highest])
        # Equal frequencies move together at the centre, where odd modes have a shape of one.
        omega, count = np.unique(np.round(omega, 6), return_counts=True)
        inverse_mass = 4.0 / (per_area * self.size**2) * count
        damping, theta = (
            0.5 * self.loss_factor * omega,
            omega * math.sqrt(1 - self.loss_factor**2 / 4),
        )
        pole = -damping + 1j * theta
        turn = np.exp(pole * step)
        # z' = pole z + g F, displacement Im z / theta; F linear over a step.
        x = pole * step
        one, two = (turn - 1) / x, (turn - 1 - x) / x**2
        late, early = inverse_mass * step * two, inverse_mass * step * (one - two)
        z = np.zeros(len(omega), complex)
        # The modes above are a spring: 2 Y/(pi w) of an infinite plate.
        spring = 2.0 / (math.pi * 8.0 * math.sqrt(bending * per_area) * 2 * math.pi * highest)
        gain = float(np.sum(late.imag / theta)) + step * step / (6.0 * mass) + spring
        height, speed, force = 0.0, -math.sqrt(2 * GRAVITY * self.height), 0.0
        steps = int(duration / step)
        forces, speeds = np.zeros(steps + 1), np.zeros(steps + 1)
        for k in range(1, steps + 1):
            z = turn * z - early * force
            free = height + step * speed - 0.5 * GRAVITY * step**2 + step**2 / mass * force / 3.0
            gap = free - float(np.sum(z.imag / theta))
            new = self._solved(s, gap, gain)
            z = z - late * new
            height = free + step**2 / (6.0 * mass) * new
            speed += -GRAVITY * step + 0.5 * step / mass * (force + new)
            speeds[k] = float(np.sum(z.real - damping / theta * z.imag))
            speeds[k] -= spring * (new - force) / step
            force = new
            forces[k] = force
        return step * np.arange(steps + 1), forces, speeds

    def _solved(self, s: float, gap: float, gain: float) -> float:
        """Force with F = s (-(gap + gain F))^1.5, by bisection."""
        low, high = 0.0, s * max(-gap, 0.0) ** 1.5
        for _ in range(60):
            middle = 0.5 * (low + high)
            if s * max(-(gap + gain * middle), 0.0) ** 1.5 > middle:
                low = middle
            else:
                high = middle
            if high - low < 1e-11 * high:
                break
        return 0.5 * (low + high)


def scene_of(drop: Drop) -> Setup:
    """The same drop as a setup of the package."""
    bodies = ("sphere", drop.of_ball), ("plate", drop.of_plate)
    middle = f"[{drop.size / 2},{drop.size / 2}]"
    settings = [
        "controller.law=off",
        "plate.theory=kirchhoff",
        f"plate.thickness_m={drop.thickness}",
        f"plate.size_m=[{drop.size},{drop.size}]",
        f"plate.contact_point_m={middle}",
        f"plate.actuator_point_m={middle}",
        f"plate.loss_factor={drop.loss_factor}",
        f"sphere.radius_m={drop.radius}",
        f"sphere.drop_height_m={drop.height}",
    ]
    for body, (young_pa, density_kg_m3, poisson) in bodies:
        settings += [
            f"{body}.material.young_pa={young_pa}",
            f"{body}.material.poisson={poisson}",
            f"{body}.material.density_kg_m3={density_kg_m3}",
        ]
    return load("aluminium-3mm", settings)
