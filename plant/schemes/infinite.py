"""The infinite plate: what a plate is to a contact until its reflections return (Zener 1941)."""

import math
from typing import Any

import numpy as np

from hertzloop.plant.contact import elastic_kernels as elastic
from hertzloop.plant.plant import NO_MODES, Plant, PlantSpec, common_fields
from hertzloop.plant.schemes import infinite_kernels
from hertzloop.plant.schemes.infinite_kernels import BODY_SIZE
from hertzloop.plant.state_kernels import BALANCE_SIZE, COUNTS_SIZE
from hertzloop.plant.structures.plate import Plate


def impedance_n_s_m(plate: Plate) -> float:
    """Point impedance of an infinite plate with the plate's loss factor on every mode, N s/m.

    A unit impulse displaces the point of an undamped plate by 1/Z, Z = 8 sqrt(B' m''), at once
    and for good. With eta on every mode, the integral of
    exp(-eta w t/2) sin(c w t)/(c w) over all frequencies, c = sqrt(1 - eta^2/4), is still
    constant in time: atan(2 c/eta)/c in place of pi/2.
    """
    c = math.sqrt(1.0 - plate.eta**2 / 4.0)
    return plate.infinite_plate_impedance_n_s_m * 0.5 * math.pi * c / math.atan2(2.0 * c, plate.eta)


def build_model(spec: PlantSpec) -> infinite_kernels.InfiniteModel:
    """Coefficients of one step. Raises ValueError when the actuator is not at the contact."""
    if not spec.same_point:
        raise ValueError("the infinite plate knows a force at the contact point only")
    h, m, z = spec.step_s, spec.sphere.mass_kg, impedance_n_s_m(spec.local_plate)
    gains = np.zeros(elastic.GAINS)
    # Displacement, velocity and mean displacement of the plate by F_0 and F_1.
    gains[elastic.PX0], gains[elastic.PX1] = h / z, 0.0
    gains[elastic.PV0], gains[elastic.PV1] = 1.0 / z, 1.0 / z
    gains[elastic.PM0], gains[elastic.PM1] = h / (2.0 * z), -h / (6.0 * z)
    gains[elastic.CA], gains[elastic.VA], gains[elastic.MA] = h / z, 1.0 / z, h / (2.0 * z)
    elastic.add_sphere(gains, h, m)
    return infinite_kernels.InfiniteModel(
        step_s=h,
        flexibility_m_n=0.0,
        same_point=True,
        impedance_n_s_m=z,
        gains=gains,
        **common_fields(spec),
    )


class InfinitePlant(Plant):
    """The infinite plate with the contact of the scheme `modal`: order 4, energy to rounding.

    Raises ValueError when the actuator is not at the contact.
    """

    kernels: Any = infinite_kernels

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.modes = NO_MODES
        self.model = self._build_model()
        self.state = self._initial_state()

    def _build_model(self) -> infinite_kernels.InfiniteModel:
        return build_model(self.spec)

    def _empty_state(self) -> infinite_kernels.InfiniteState:
        return infinite_kernels.InfiniteState(
            body=np.zeros(BODY_SIZE),
            balance=np.zeros(BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
        )
