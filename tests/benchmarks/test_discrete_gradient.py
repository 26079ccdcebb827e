"""The scheme of the benchmarks: its order, its energy, and a run by the interface for schemes."""

import numpy as np
import pytest

from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from tests.plant.rigs import run, spec
from tests.plant.test_modal import CASES
from tests.plant.test_solution import reference

STEPS_S = (1e-6, 5e-7, 2.5e-7, 1.25e-7)
CONTACT_S = 40e-6  # longer than any contact below


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_gap_converges_as_the_step_squared(case):
    changes, push = CASES[case]
    t = STEPS_S[-1] * np.arange(1, round(CONTACT_S / STEPS_S[-1]) + 1)
    solution = reference(spec(**changes), lambda _: np.asarray(push), t)
    errors = []
    for h in STEPS_S:
        plant = DiscreteGradientPlant(spec(step_s=h, lead_in_s=0.0, **changes))
        steps, every = round(CONTACT_S / h), round(h / STEPS_S[-1])
        gaps = run(plant, steps, np.full(steps, push)).xi[1:]
        errors.append(abs(gaps - solution[every - 1 : -every : every]).max() / -solution.min())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(f"{case}: {len(plant.modes.omega)} frequencies, errors {errors}, orders {orders}")
    assert solution[-1] > 0.0  # a whole contact
    assert 1.8 < orders.mean() < 2.2
