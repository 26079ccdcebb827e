"""The scheme of the benchmarks: its order, its energy, and a run by the interface for schemes."""

import numpy as np
import pytest

from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from tests.plant.test_modal import CASES, errors_of

STEPS_S = (1e-6, 5e-7, 2.5e-7, 1.25e-7)


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_gap_converges_as_the_step_squared(case):
    errors = errors_of(DiscreteGradientPlant, case, STEPS_S)
    assert 1.8 < np.log2(errors[:-1] / errors[1:]).mean() < 2.2
