"""The chart's integrators have the orders and limits they are known for."""

import numpy as np
import pytest

from benchmarks import integrator_kernels as ik
from benchmarks import integrators


@pytest.fixture(scope="module")
def small():
    what = integrators.problem("aluminium-3mm", 6e-5)
    keep = np.sqrt(what.omega2) < 2 * np.pi * 30e3
    return integrators.Problem(
        what.name, what.spec, what.duration_s, what.omega2[keep], what.drive[keep]
    )


@pytest.mark.full
def test_reference_is_dop853s(small):
    solved = integrators.dop853_run(small, 1e-10)()
    found = integrators.kernel_run(ik.rk4, small, 6.25e-8)().gaps
    assert solved.evaluations > 100
    largest = np.abs(solved.gaps).max()
    np.testing.assert_allclose(found, solved.gaps, rtol=0, atol=1e-5 * largest)
