"""Zero latency and ideal converters: the sampled loop tends to the continuous law."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hertzloop.loop.simulate import simulate
from hertzloop.plant.plant import modes_of
from hertzloop.plant.time_series import F_A, XI
from hertzloop.scene.setup import Setup
from tests.hertzloop.scenes import aluminium_3mm
from tests.latency.modes_alone import modes_alone

KEYS = ["controller.v_thr_m_s=-0.6", "run.duration_s=0.00007", "run.lead_in_s=0.00002"]
STEPS_NS = (1000, 100, 10)
Plate = tuple[str, ...]  # settings


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """The modes of the equations below, without a spring for those left out."""
    folder = tmp_path_factory.mktemp("ideal")
    return tuple(modes_alone("aluminium-3mm", 0.2, folder / "modes.csv"))


def scene(plate: Plate, step_ns: int) -> Setup:
    return aluminium_3mm(*KEYS, *plate, f"run.step_ns={step_ns}")


@cache
def continuous(plate: Plate) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times since the first touch, gap and actuator force under the law itself, and the delay.

    The modal equations with F_a = kappa s p(t - t_a)^1.5 by Runge-Kutta 8 in pieces of t_a, the
    delayed penetration from the pieces before.
    """
    of = scene(plate, 1000)
    spec = of.plant
    modes = modes_of(spec)
    drive = modes.scale_per_kg * modes.contact**2
    m, s = spec.sphere.mass_kg, spec.contact.stiffness
    kappa, v_thr, n = (
        of.scene.controller.keys.kappa,
        of.scene.controller.keys.v_thr_m_s,
        len(modes.omega),
    )

    def gap(y: np.ndarray) -> float:
        return float(y[2 * n] - y[:n].sum())

    def slope(force_a):  # type: ignore[no-untyped-def]
        def right(t: float, y: np.ndarray) -> np.ndarray:
            f_c = s * max(-gap(y), 0.0) ** 1.5
            acceleration = drive * (force_a(t) - f_c) - modes.omega**2 * y[:n]
            return np.concatenate([y[n : 2 * n], acceleration, [y[-1], f_c / m - 9.81]])

        return right

    def crosses(t: float, y: np.ndarray) -> float:
        return float(y[-1] - y[n : 2 * n].sum()) - v_thr

    crosses.terminal = True  # type: ignore[attr-defined]
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-15, "dense_output": True}
    y = np.zeros(2 * n + 2)
    y[-1] = -spec.sphere.impact_speed_m_s
    first = solve_ivp(slope(lambda t: 0.0), (0.0, 1e-4), y, events=crosses, **options)
    delay = float(first.t[-1])
    pieces = [(0.0, delay, first)]
    end, y = delay, first.y[:, -1]

    def earlier(t: float) -> float:
        for start, stop, piece in pieces:
            if start <= t <= stop:
                return kappa * s * max(-gap(piece.sol(t)), 0.0) ** 1.5
        return 0.0

    while end < 4.5e-5:
        piece = solve_ivp(slope(lambda t: earlier(t - delay)), (end, end + delay), y, **options)
        pieces.append((end, end + delay, piece))
        end, y = end + delay, piece.y[:, -1]
    t = np.linspace(0.0, 4.4e-5, 300)
    found = [next(p for a, b, p in pieces if a <= x <= b).sol(x) for x in t]
    gaps = np.array([gap(y) for y in found])
    forces = np.array([earlier(x - delay) if x >= delay else 0.0 for x in t])
    return t, gaps, forces, delay


@cache
def gap_and_force(plate: Plate, step_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Gap and actuator force of the sampled loop at the times of `continuous`."""
    t = continuous(plate)[0]
    of = scene(plate, step_ns)
    rows, h = simulate(of).truth, of.run.step_s
    touch = (math.floor(of.run.lead_in_s / h) + 0.5) * h
    at = np.arange(rows.shape[1]) * h - touch
    # The force of a step is held: its middle is half a step later.
    return np.interp(t, at, rows[XI]), np.interp(t, at + 0.5 * h, rows[F_A])


def test_the_loop_tends_to_the_continuous_law_with_the_step(plate):
    """The dead time is one step, so what is left falls in proportion to it; in the long run only,
    as the latched delay is a whole number of samples."""
    _, gaps, forces, _ = continuous(plate)
    found = [gap_and_force(plate, step) for step in STEPS_NS]
    of_gap = [np.abs(gap - gaps).max() / np.abs(gaps.min()) for gap, _ in found]
    of_force = [np.abs(force - forces).max() / forces.max() for _, force in found]
    for errors in (of_gap, of_force):
        assert errors[0] / errors[-1] > 50.0
        for coarse, fine in pairwise(errors):
            assert coarse / fine > 4.0
    assert of_gap[-1] < 0.0015
    assert of_force[-1] < 0.004


def test_the_latched_delay_tends_to_the_continuous_one(plate):
    delay = continuous(plate)[3]
    for step in STEPS_NS:
        latched = simulate(scene(plate, step)).delays[-1] * step * 1e-9
        assert abs(latched - delay) <= 2.0 * step * 1e-9
