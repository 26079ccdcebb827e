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


@pytest.mark.parametrize(
    ("kernel", "order"),
    [
        (ik.verlet, 2),
        (ik.rk4, 2.5),  # the contact's force has one and a half derivatives
    ],
)
def test_order_of_convergence(small, kernel, order):  # type: ignore[no-untyped-def]
    finest = integrators.kernel_run(ik.rk4, small, 3.125e-8)().gaps
    errors = [
        np.abs(integrators.kernel_run(kernel, small, h)().gaps - finest).max()
        for h in (1e-6, 5e-7, 2.5e-7)
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.mean() > order - 0.3
    if order == 2:
        assert orders.mean() < 2.3


def test_reference_is_dop853s(small):
    solved = integrators.dop853_run(small, 1e-10)()
    found = integrators.kernel_run(ik.rk4, small, 6.25e-8)().gaps
    assert solved.evaluations > 100
    largest = np.abs(solved.gaps).max()
    np.testing.assert_allclose(found, solved.gaps, rtol=0, atol=1e-5 * largest)
