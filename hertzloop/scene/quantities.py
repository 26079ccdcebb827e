"""The one table of sensed quantities: names, units, meaning.

A new sensed quantity is a row of `SENSED`, if the state of the plant has it. Scenes, laws,
converter, exports and the trial of a law follow; the replay draws it with the gap, unless
`recordings/replay/plots.py` names another plot.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hertzloop.plant import state_kernels

# Ranges of converters, of the largest value on a rigid plate.
_GAP_LOW, _GAP_HIGH, _ABOVE = -1.25, 0.25, 1.25


class Expected(NamedTuple):
    """How far an impact goes, on a rigid plate; `flight_m` above it a law has to see the sphere,
    `velocity_m_s()` is that of the plate, which something else than a plate has not."""

    rigid_m: float
    deepest_m: float  # the same, where the contact yields
    flight_m: float
    force_n: float
    velocity_m_s: Callable[[], float]
    contact_s: float


class Trial(NamedTuple):
    """A made-up impact that a law is tried on, a value a sample; shapes (samples,)."""

    gap_m: np.ndarray
    force_n: np.ndarray
    velocity_m_s: np.ndarray  # of the plate
    sample_s: float


class Sensed(NamedTuple):
    """A quantity that the data acquisition can have as its input."""

    unit: str
    meaning: str
    of_state: int  # index into the plant's state
    range: Callable[[Expected], tuple[float, float]]  # of a converter: lowest, highest value
    trial: Callable[[Trial], np.ndarray]  # samples of the made-up impact
    over_step: bool = False  # a mean over the step before the sample, not a value at its time
    elsewhere: int | None = None  # index of the same where a sensor elsewhere is; None: no such


def _either_way(most: float) -> tuple[float, float]:
    return -_ABOVE * most, _ABOVE * most


# By the name that scenes and laws use.
SENSED = {
    "xi": Sensed(
        "m", "sampled gap, at the time of the sample", state_kernels.XI,
        lambda e: (_GAP_LOW * e.deepest_m, max(_GAP_HIGH * e.rigid_m, e.flight_m)),
        lambda t: t.gap_m,
    ),
    "v_p": Sensed(
        "m/s", "sampled plate velocity, at the time of the sample", state_kernels.V_P,
        lambda e: _either_way(e.velocity_m_s()), lambda t: t.velocity_m_s,
        elsewhere=state_kernels.SENSOR_V,
    ),
    "acceleration": Sensed(
        "m/s^2", "sampled plate acceleration, mean of the step before", state_kernels.A_P,
        lambda e: _either_way(e.velocity_m_s() * (np.pi / e.contact_s)),
        lambda t: np.gradient(t.velocity_m_s, t.sample_s), over_step=True,
        elsewhere=state_kernels.SENSOR_A,
    ),
    "contact_force": Sensed(
        "N", "sampled contact force, mean of the step before", state_kernels.F_C,
        lambda e: (0.0, _ABOVE * e.force_n), lambda t: t.force_n, over_step=True,
    ),
}  # fmt: skip
