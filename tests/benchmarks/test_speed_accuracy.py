"""The chart's integrators have the orders and limits they are known for."""

import math

import numpy as np
import pytest

from benchmarks import integrator_kernels as ik
from benchmarks import integrators
from benchmarks import speed_accuracy as study


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


@pytest.mark.full
def test_points_are_written_and_modal_leads(tmp_path):
    points = study.measure("aluminium-3mm", 6e-5, rounds=1)
    modal = [p for p in points if p.scheme == "modal"]
    assert [p.error for p in modal] == sorted((p.error for p in modal), reverse=True)
    assert all(abs(p.energy_drift) < 1e-11 for p in modal)
    errors = np.array([p.error for p in modal])
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - 4.0) < 0.5)
    assert [p.error for p in points if (p.scheme, p.setting) == ("verlet", "4 us")] == [math.inf]
    study.draw(tmp_path / "a.png", ["aluminium-3mm"], points)
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_the_conclusion_takes_the_fastest_solver_that_is_accurate_enough():
    def point(scheme: str, error: float, cpu: float, scene: str = "a") -> study.Point:
        return study.Point(scene, scheme, "", error, 0.0, cpu)

    points = [
        point("modal", 1e-4, 1.0),
        point("modal", 1e-2, 0.1),
        point("dop853", 1e-2, 0.5),
        point("cvode", 1e-3, 3.0),
        point("dop853", 1e-6, 4.0),
        point("modal", 1e-4, 1.0, "b"),
        point("dop853", 1e-6, 5.0, "b"),
    ]
    assert study.conclusion(points) == (
        "At an error of 0.001 the default scheme is 4 times as fast as the fastest general "
        "solver, median of 2 scenes."
    )
