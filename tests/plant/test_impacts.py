"""Metrics of each impact from rows of truth made by hand, with known crossings."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from tests.plant.rigs import spec

H = 0.5  # s; round numbers keep the expected values readable
WHAT = spec(step_s=H)
MASS = WHAT.sphere.mass_kg


def of(xi, f_c, xi_p=0.0, f_a=0.0, xi_a=None) -> list[Impact]:
    truth, what = np.zeros((ts.COLUMNS, len(xi))), WHAT
    truth[ts.XI], truth[ts.XI_P], truth[ts.F_C], truth[ts.F_A] = xi, xi_p, f_c, f_a
    truth[ts.XI_S] = truth[ts.XI] + truth[ts.XI_P]
    if xi_a is not None:
        truth[ts.XI_A], what = xi_a, replace(WHAT, actuator_point_m=(0.2, 0.2))
    return impacts_in(what, truth)


def test_no_contact_no_impact():
    assert of([3.0, 2.0, 1.0, 0.5], [0.0] * 4) == []
    assert of([1.0, 1.0], [0.0, 0.0]) == []
    assert of([], []) == []


def test_crossings_are_interpolated_and_contacts_told_apart():
    # Enters a quarter into the second step, leaves half way through the fifth; then a short one.
    xi = [4.0, 1.0, -3.0, -2.0, -1.0, 1.0, 2.0, 1.0, -1.0, 3.0, 4.0]
    f_c = [0.0, 5.0, 9.0, 7.0, 2.0, 0.0, 0.0, 1.0, 1.5, 0.0, 0.0]
    first, second = of(xi, f_c)
    assert first.start_s == pytest.approx(1.25 * H)
    assert first.duration_s == pytest.approx((4.5 - 1.25) * H)
    assert first.peak_force_n == 9.0
    assert second.start_s == pytest.approx(7.5 * H)
    assert second.duration_s == pytest.approx((8.25 - 7.5) * H)
    assert second.peak_force_n == 1.5


def test_speeds_are_the_spheres_at_the_steps_around_a_contact():
    # A flight at 3 m/s down, one step of force, a flight; the plate moves as well.
    v, force = -3.0, 4.0
    x, xs, speeds = 1.4, [], []
    forces = [0.0, force, force, 0.0, 0.0]
    for f in forces:
        xs.append(x)
        speeds.append(v)
        a = f / MASS - GRAVITY_M_S2
        x, v = x + v * H + 0.5 * a * H * H, v + a * H
    sphere = np.array(xs)
    plate = np.array([0.0, 0.0, 5.0, 2.0, 1.0])
    (one,) = of(sphere - plate, forces, plate)
    assert one.impact_speed_m_s == pytest.approx(-speeds[1], rel=1e-13)
    assert one.rebound_speed_m_s == pytest.approx(speeds[3], rel=1e-13)


def test_contact_from_the_first_row():
    (at_once,) = of([0.0, -1.0, 1.0, 2.0], [1.0, 1.0, 0.0, 0.0])
    assert at_once.start_s == 0.0
    assert at_once.duration_s == pytest.approx(1.5 * H)
    (within,) = of([1.0, -1.0, 1.0, 2.0], [1.0, 1.0, 0.0, 0.0])
    assert within.start_s == pytest.approx(0.5 * H)
    assert within.duration_s == pytest.approx(1.0 * H)
    (before,) = of([-1.0, -1.0, 1.0, 2.0], [1.0, 1.0, 0.0, 0.0])
    assert before.start_s == 0.0


def test_contact_that_the_end_cuts_off_counts_with_what_there_is():
    (found,) = of([1.0, -1.0, -2.0, -2.0], [2.0, 3.0, 4.0, 3.0])
    assert found.start_s == pytest.approx(0.5 * H)
    assert found.duration_s == pytest.approx(2.5 * H)
    assert found.peak_force_n == 4.0


def test_a_contact_that_begins_in_the_last_step_is_not_one_yet():
    # It would have no duration, by which metrics divide.
    found = of([1.0, -3.0, -2.0, 1.0, 2.0, 1.0], [5.0, 9.0, 7.0, 0.0, 0.0, 2.0])
    assert len(found) == 1
    assert of([3.0, 2.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0]) == []


def test_plate_energy_is_the_work_of_both_forces_at_their_points():
    xi = [1.0, -1.0, 1.0, 2.0, -1.0, 1.0]
    f_c = [2.0, 3.0, 0.0, 1.0, 5.0, 0.0]
    xi_p = [0.0, -1.0, -3.0, -2.0, -2.5, -2.0]
    f_a = [0.0, 4.0, 2.0, 0.0, 1.0, 0.0]
    xi_a = [0.0, 1.0, 2.0, 4.0, 3.0, 3.5]
    # By hand: -F_c d xi_p + F_a d xi_a from one contact's first step to the next one's.
    contact_work = [2.0, 6.0, 0.0, 0.5, -2.5]
    same, apart = of(xi, f_c, xi_p, f_a), of(xi, f_c, xi_p, f_a, xi_a)
    pushed = [0.0, 4.0 * -2.0, 2.0 * 1.0, 0.0, 1.0 * 0.5]
    beside = [0.0, 4.0 * 1.0, 2.0 * 2.0, 0.0, 1.0 * 0.5]
    for found, push in ((same, pushed), (apart, beside)):
        work = np.add(contact_work, push)
        assert [i.plate_energy_j for i in found] == pytest.approx([work[:3].sum(), work[3:].sum()])


@pytest.mark.parametrize("name", ["aluminium-20mm", "offcentre-6mm"])
def test_energies_of_a_run_add_up_to_what_its_plate_took(name):
    scene = load(name, ["run.duration_s=0.02", "plate.loss_factor=0.01"])
    truth = simulate(scene)
    rows, balance = truth.truth, truth.balance
    found = impacts_in(scene.plant, rows)
    # Work of both forces is energy in the plate now, or already lost in it.
    taken = balance.modal_j + balance.modal_dissipated_j
    assert rows[4][-1] == 0.0  # the last step's work is in no row
    assert rows[5][-1] == 0.0
    assert sum(i.plate_energy_j for i in found) == pytest.approx(taken, rel=3e-5)
    first = found[0]
    # A fall of 1 ms less than the whole: v at contact is sqrt(2 g h), to a step of gravity.
    fall = math.sqrt(2.0 * GRAVITY_M_S2 * 0.05)
    assert first.impact_speed_m_s == pytest.approx(fall, abs=GRAVITY_M_S2 * scene.run.step_s)
    assert first.start_s == pytest.approx(1e-3, abs=scene.run.step_s)


def test_a_contact_within_one_step_is_one():
    """A graze between two steps counts with the whole step."""
    (found,) = of([3.0, 1.0, 2.0, 4.0], [0.0, 5.0, 0.0, 0.0])
    assert found.start_s == pytest.approx(H)
    assert found.duration_s == pytest.approx(H)
    assert found.peak_force_n == 5.0


@pytest.mark.parametrize(("step_ns", "scheme"), [(200_000, "modal"), (1_000_000, "thesis2008")])
def test_a_contact_shorter_than_a_step_is_refused(step_ns, scheme):
    scene = "thesis-aluminium" if scheme == "thesis2008" else "aluminium-3mm"
    keys = [
        "sphere.radius_m=0.003",
        "controller.law=off",
        f"run.step_ns={step_ns}",
        f"run.scheme={scheme}",
    ]
    with pytest.raises(SceneError, match=f"run.step_ns = {step_ns}: is longer than a contact"):
        simulate(load(scene, keys))
