"""The actuator between the controller's line and the plate: bandwidth, moving mass, limit."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from plant.actuator.kernels import ForceLimit, SecondOrder


@dataclass(frozen=True)
class Actuator:
    """Second order up to `bandwidth_hz` with `damping` (of critical; without a bandwidth it
    follows at once), a mass that moves with the plate, and the largest force (N; None: any)."""

    bandwidth_hz: float | None = None
    damping: float = 0.7
    mass_kg: float = 0.0
    force_limit_n: float | None = None

    @property
    def ideal(self) -> bool:
        """Whether every command acts on the plate alone, as it is."""
        return self.bandwidth_hz is None and self.force_limit_n is None and self.mass_kg == 0.0

    @property
    def delay_s(self) -> float:
        """By how much a slow command comes later, 2 zeta/w, s."""
        if self.bandwidth_hz is None:
            return 0.0
        return 2.0 * self.damping / (2.0 * math.pi * self.bandwidth_hz)


IDEAL = Actuator()


def build_model(actuator: Actuator, step_s: float) -> SecondOrder | ForceLimit | None:
    """Coefficients of one step; the mass is part of the plate's modes, see plant.actuator.mass."""
    limit = math.inf if actuator.force_limit_n is None else actuator.force_limit_n
    if actuator.bandwidth_hz is None:
        return None if actuator.force_limit_n is None else ForceLimit(float(limit))
    zeta = actuator.damping
    turn = 2.0 * math.pi * actuator.bandwidth_hz * step_s
    one = np.eye(2)
    # exp of these blocks holds phi_0, phi_1 and phi_2 of the first one in its first row.
    blocks = np.zeros((6, 6))
    blocks[:2, :2] = turn * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    blocks[:2, 2:4] = blocks[2:4, 4:] = one
    phi = scipy.linalg.expm(blocks)[:2]
    (mean_f, mean_d), (slope_f, slope_d) = phi[0, 2:4], 3.0 * (phi[0, 2:4] - 2.0 * phi[0, 4:])
    return SecondOrder(
        turn_ff=float(phi[0, 0]),
        turn_fd=float(phi[0, 1]),
        turn_df=float(phi[1, 0]),
        turn_dd=float(phi[1, 1]),
        mean_f=float(mean_f),
        mean_d=float(mean_d),
        slope_f=float(slope_f),
        slope_d=float(slope_d),
        limit_n=float(limit),
    )
