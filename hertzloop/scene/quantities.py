"""The one table of sensed quantities: names, units, meaning.

A new sensed quantity is a row of `SENSED`, if the state of the plant has it. Scenes, laws,
converter, exports and the trial of a law follow; the replay draws it with the gap, unless
`recordings/replay/plots.py` names another plot.
"""

import numpy as np

from hertzloop.common.protocols import SensedQuantity
from hertzloop.plant import state_kernels

# Ranges of converters, of the largest value on a rigid plate.
_GAP_LOW, _GAP_HIGH, _ABOVE = -1.25, 0.25, 1.25


def _either_way(most: float) -> tuple[float, float]:
    return -_ABOVE * most, _ABOVE * most


# By the name that scenes and laws use.
SENSED = {
    "xi": SensedQuantity(
        "m", "sampled gap, at the time of the sample", state_kernels.XI,
        lambda e: (_GAP_LOW * e.deepest_m, max(_GAP_HIGH * e.rigid_m, e.flight_m)),
        lambda t: t.gap_m,
    ),
    "v_p": SensedQuantity(
        "m/s", "sampled plate velocity, at the time of the sample", state_kernels.V_P,
        lambda e: _either_way(e.velocity_m_s()), lambda t: t.velocity_m_s,
        elsewhere=state_kernels.SENSOR_V,
    ),
    "acceleration": SensedQuantity(
        "m/s^2", "sampled plate acceleration, mean of the step before", state_kernels.A_P,
        lambda e: _either_way(e.velocity_m_s() * (np.pi / e.contact_s)),
        lambda t: np.gradient(t.velocity_m_s, t.sample_s), over_step=True,
        elsewhere=state_kernels.SENSOR_A,
    ),
    "contact_force": SensedQuantity(
        "N", "sampled contact force, mean of the step before", state_kernels.F_C,
        lambda e: (0.0, _ABOVE * e.force_n), lambda t: t.force_n, over_step=True,
    ),
}  # fmt: skip
