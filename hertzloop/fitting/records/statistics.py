"""Statistics that a few outliers do not change."""

import numpy as np

_NORMAL = 1.4826  # standard deviation of normal noise over the median of its size


def robust_deviation(deviations: np.ndarray) -> float:
    """Return the standard deviation of normal noise from deviations around its centre, (samples,).

    Missing values (nan) do not count.
    """
    return _NORMAL * float(np.nanmedian(np.abs(deviations)))
