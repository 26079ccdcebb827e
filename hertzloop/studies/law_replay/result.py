"""The forces of another law on recorded samples, beside the recorded forces."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ForceComparison:
    """Forces (N) of every step that both know, and the first step at which they differ."""

    recorded_n: np.ndarray
    other_n: np.ndarray
    first: int | None
    step_s: float
