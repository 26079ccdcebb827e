"""Peaks within steps: cubics exactly, and the forces of real contacts at any step."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in, peak_force_n, peak_speed_m_s
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.setup import load

FREE = "controller.law=off"
SHORT = "run.duration_s=0.0012"


def steps_of(force: np.polynomial.Polynomial, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and slope of a force over steps of length 1."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    values = force(np.arange(count)[:, None] + 0.5 * (nodes + 1.0))
    return values @ weights / 2.0, 1.5 * (values * nodes) @ weights


@pytest.mark.parametrize("top", [3.0, 3.1, 3.5, 3.98, 4.0])
def test_peak_of_a_cubic_is_exact(top):
    x = np.polynomial.Polynomial([-top, 1.0])
    force = 10.0 - x**2 + 0.05 * x**3
    mean, slope = steps_of(force, 8)
    assert peak_force_n(mean, slope) == pytest.approx(10.0, rel=1e-12)
    assert np.max(mean) < 9.95
    assert abs(np.max(mean + abs(slope)) - 10.0) > 1e-2


def test_what_has_no_slopes_or_is_too_short():
    assert peak_force_n(np.array([1.0, 3.0, 2.0]), np.zeros(3)) == 3.0
    assert peak_force_n(np.array([1.0, 3.0]), np.array([1.0, -0.5])) == 3.5


def test_peak_of_a_speed_between_steps():
    t = np.arange(10.0)
    assert peak_speed_m_s(-(5.0 - 0.1 * (t - 4.3) ** 2)) == pytest.approx(5.0, rel=1e-12)
    assert peak_speed_m_s(t) == 9.0


def peak(scene: str, *settings: str) -> float:
    loaded = load(scene, [SHORT, *settings])
    return impacts_in(loaded.plant, simulate(loaded).truth)[0].peak_force_n


def test_peak_of_the_default_scene():
    """88.104 N by an independent solver with all modes; the means say 87.9."""
    assert peak("aluminium-3mm", FREE) == pytest.approx(88.104, rel=3e-5)


def test_peak_does_not_depend_on_the_step():
    wanted = peak("aluminium-3mm", FREE, "run.step_ns=250", "run.accuracy=1e-3")
    for step_ns, close in ((500, 1e-6), (1000, 2e-5), (2000, 1e-4)):
        found = peak("aluminium-3mm", FREE, f"run.step_ns={step_ns}", "run.accuracy=1e-3")
        assert found == pytest.approx(wanted, rel=close), step_ns


def test_plate_speed_is_that_of_each_contact():
    """Waves from the edges make it larger after the first impact: 0.54 m/s within the run."""
    loaded = load("aluminium-3mm", [FREE, "run.duration_s=0.02"])
    found = metrics_of(loaded, simulate(loaded).truth)
    assert found.impacts[0].plate_speed_max_m_s == pytest.approx(0.286, abs=2e-3)
    assert found.first_impact.plate_speed_max_m_s == found.noise[0].plate_speed_max_m_s
    assert found.whole_run.plate_speed_max_m_s > 0.4
