"""The chart's integrators have the orders and limits they are known for."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import integrator_kernels as ik
from benchmarks import integrators
from benchmarks import speed_accuracy as study


@pytest.fixture(scope="module")
def small() -> integrators.Problem:
    what = integrators.problem("aluminium-3mm", 6e-5)
    keep = np.sqrt(what.omega2) < 2 * np.pi * 30e3
    return integrators.Problem(
        what.name, what.spec, what.duration_s, what.omega2[keep], what.drive[keep]
    )


@pytest.mark.parametrize(
    ("kernel", "more", "order"),
    [
        (ik.verlet, (), 2),
        (ik.alpha_method, (0.0,), 2),
        (ik.alpha_method, (-0.2,), 2),
        (ik.rk4, (), 2.5),  # the contact's force has one and a half derivatives
    ],
)
def test_order_of_convergence(
    small: integrators.Problem, kernel, more: tuple, order: float
) -> None:  # type: ignore[no-untyped-def]
    finest = integrators.kernel_run(ik.rk4, small, 3.125e-8)()[0]
    errors = [
        np.abs(integrators.kernel_run(kernel, small, h, *more)()[0] - finest).max()
        for h in (1e-6, 5e-7, 2.5e-7)
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.mean() > order - 0.3
    if order == 2:
        assert orders.mean() < 2.3


@pytest.mark.parametrize(("kernel", "limit"), [(ik.verlet, 2.0), (ik.rk4, 2.83)])
def test_stability_limit(kernel, limit: float) -> None:  # type: ignore[no-untyped-def]
    """Free vibration just inside and just outside of w h."""
    for factor, stays in ((0.99, True), (1.01, False)):
        omega2 = np.array([1e12])
        y = np.array([1e-6, 0.0, 1.0, 0.0])  # the sphere is far away
        gaps = np.empty(1)
        h = factor * limit / 1e6
        kernel(y, omega2, np.array([1.0]), 1e10, 1.0, h, 2000, 2000, gaps)
        assert (abs(y[0]) < 1e-5) == stays


def test_average_acceleration_has_no_limit() -> None:
    y = np.array([1e-6, 0.0, 1.0, 0.0])
    ik.alpha_method(
        y, np.array([1e12]), np.array([1.0]), 1e10, 1.0, 1e-3, 500, 500, np.empty(1), 0.0
    )
    assert abs(y[0]) < 1.1e-6


def test_reference_is_dop853s(small: integrators.Problem) -> None:
    count = [0]
    solved = integrators.scipy_run("DOP853", small, 1e-10, count)()[0]
    found = integrators.kernel_run(ik.rk4, small, 6.25e-8)()[0]
    assert count[0] > 100
    np.testing.assert_allclose(found, solved, rtol=0, atol=1e-5 * np.abs(solved).max())


@pytest.mark.full
def test_points_are_written_and_modal_leads(tmp_path: Path) -> None:
    points = study.measure("aluminium-3mm", 6e-5, rounds=1, limit_s=0.2)
    modal = [p for p in points if p.scheme == "modal"]
    assert [p.error for p in modal] == sorted((p.error for p in modal), reverse=True)
    assert all(abs(p.energy_drift) < 1e-11 for p in modal)
    errors = np.array([p.error for p in modal])
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - 4.0) < 0.5)
    blown = [p for p in points if p.scheme == "verlet" and p.setting == "4 us"]
    assert blown[0].status.startswith("failed")
    radau = [p for p in points if p.scheme == "radau"]
    assert len(radau) == 1
    assert radau[0].status.startswith("omitted: stopped after 0.2 s of CPU time")
    study.draw(tmp_path / "a.png", ["aluminium-3mm"], points)
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_the_conclusion_names_the_fastest_scheme_that_is_accurate_enough() -> None:
    def point(scheme: str, error: float, cpu: float, scene: str = "a", status: str = "ok") -> Any:
        return study.Point(scene, scheme, "", error, 0.0, cpu, status)

    points = [
        point("modal", 1e-4, 1.0),
        point("modal", 1e-2, 0.1),
        point("verlet", 1e-2, 0.5),
        point("rk4", 1e-3, 3.0),
        point("rk4", 1e-5, 9.0),
        point("lsoda", 1e-6, 4.0),
        point("dop853 estimate", 1e-6, 0.2, status="estimate: evaluations"),
        point("modal", 1e-4, 1.0, "b"),
        point("lsoda", 1e-6, 5.0, "b"),
        point("modal", 1e-4, 1.0, "c"),
        point("rk4", 1e-4, 2.0, "c"),
    ]
    assert study.conclusion(points) == (
        "At an error of 0.001 the default scheme is 4.5 times as fast as the fastest general "
        "solver (lsoda), and 3 times as fast as the fastest of all other schemes (lsoda, rk4), "
        "medians of 3 scenes."
    )
