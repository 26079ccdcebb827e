"""An independent solution of the motion, and what must not change it."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.state_kernels import AWAKE, GRAVITY_M_S2, XI_P
from tests.plant.brute import all_modes, modal_scale, shape
from tests.plant.rigs import after_steps, run, spec


def reference(what: PlantSpec, force: Callable, t: np.ndarray) -> np.ndarray:
    """Gap at times t after first contact: every mode (m, n) and the sphere by DOP853."""
    plate, contact = what.plate, what.contact
    m, n, omega = all_modes(plate, what.frequency_limit_hz)
    at_c = shape(plate, m, n, what.contact_point_m)
    at_a = shape(plate, m, n, what.actuator_point_m)
    moves = abs(at_c) + abs(at_a) > 1e-9
    omega, at_c, at_a = omega[moves], at_c[moves], at_a[moves]
    scale, count, loss, mass = modal_scale(plate), len(omega), plate.eta, what.sphere.mass_kg

    def slope(time: float, y: np.ndarray) -> np.ndarray:
        q, v, x_s, v_s = y[:count], y[count : 2 * count], y[-2], y[-1]
        p = at_c @ q - x_s
        f_c = 0.0
        if p > 0.0:
            rate = at_c @ v - v_s
            f_c = contact.stiffness * p**1.5 * (1.0 + contact.hunt_crossley_s_m * rate)
            f_c += contact.viscous_n_s_m * rate
        q2 = scale * (at_a * force(time) - at_c * f_c) - loss * omega * v - omega**2 * q
        return np.concatenate([v, q2, [v_s, f_c / mass - GRAVITY_M_S2]])

    begin = np.zeros(2 * count + 2)
    begin[-1] = -what.sphere.impact_speed_m_s
    solved = solve_ivp(slope, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-11, atol=1e-17)
    return np.asarray(at_c @ solved.y[:count] - solved.y[-2]) * -1.0


def test_forces_act_from_their_step_on_and_not_before():
    changed = 150  # in the middle of nothing: after the contact
    force = np.zeros(300)
    rows = run(ModalPlant(spec(limit_hz=50e3)), 300, force)
    force[changed] = 1.0
    pushed = run(ModalPlant(spec(limit_hz=50e3)), 300, force)
    for name in ("xi", "xi_s", "xi_p", "v_p", "f_c"):
        before, after = getattr(rows, name), getattr(pushed, name)
        assert np.array_equal(before[: changed + 1], after[: changed + 1])
    assert np.all(rows.xi_p[changed + 1 :] != pushed.xi_p[changed + 1 :])


def test_leaving_out_silent_modes_changes_nothing():
    # Oak to 250 kHz: the fastest modes die within milliseconds, the slowest in seconds.
    def oak() -> Plant:
        return ModalPlant(spec(material="oak", thickness_m=0.01, limit_hz=250e3, radius_m=0.006))

    steps = 6000
    optimised, awake = oak(), oak()
    rows = run(optimised, steps)
    left = int(optimised.state.counts[AWAKE])
    # A force of no consequence keeps every mode in the sums.
    other = run(awake, steps, np.full(steps, 1e-280))
    assert awake.state.counts[AWAKE] == awake.state.z.shape[1]
    assert left < 0.6 * awake.state.z.shape[1]  # or nothing was left out
    # Sums of fewer terms, and means that are taken another way, round otherwise.
    for name in ("xi", "xi_s", "xi_p", "v_p", "f_c"):
        one, all_awake = getattr(rows, name), getattr(other, name)
        np.testing.assert_allclose(one, all_awake, rtol=0.0, atol=1e-11 * np.abs(one).max())
    # The modes wake up again.
    for plant in (optimised, awake):
        after_steps(plant, (5.0, 0.0, 0.0))
    assert optimised.state.counts[AWAKE] == optimised.state.z.shape[1]
    assert optimised.state.body[XI_P] == pytest.approx(awake.state.body[XI_P], rel=1e-9)
