"""A plate that stays flat, for replays of made-up recordings."""

import numpy as np

from hertzloop.recordings.replay.deflection import Deflection


def flat_plate(times_ns: np.ndarray) -> Deflection:
    """Deflection zero at all times, of a square of 0.2 m struck in its middle."""
    w = np.zeros((len(times_ns), 3, 3))
    axis = np.array([0.0, 0.1, 0.2])
    return Deflection(times_ns, axis, axis, w, (0.1, 0.1))
