"""Contacts on an immovable support against closed forms, and contact damping."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from hertzloop.closed_loop.parts import series_under
from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    hertz_stiffness,
    hunt_crossley_parameter,
    rigid_contact_time_s,
    rigid_peak_force_n,
)
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.state_kernels import FLIGHT_V, FLIGHT_X, XI, XI_S
from hertzloop.plant.structures.materials import MATERIALS
from tests.plant.rigs import rigid, run, spec

STIFFNESS = hertz_stiffness(0.003, MATERIALS["steel"], MATERIALS["aluminium"])
STEPS_S = (2e-6, 1e-6, 5e-7)
SPEED = 1.0
RESTITUTIONS = (0.2, 0.6, 0.9)


def hertz_errors(step_s: float) -> tuple[float, float]:
    """Relative error of contact time and peak force on a rigid half-space (27 us, 1 m/s)."""
    plant = rigid(step_s, Contact(STIFFNESS), speed_m_s=SPEED)
    mass = plant.model.mass_kg
    contact_s = rigid_contact_time_s(mass, STIFFNESS, SPEED)
    truth = series_under(plant, np.zeros(round(1.3 * contact_s / step_s)))
    assert abs(truth[ts.XI_P]).max() < 1e-20  # the support does not give way
    (found,) = impacts_in(plant.spec, truth)
    # Peak of the parabola through the three largest forces: no error from where samples fall.
    top = int(np.argmax(truth[ts.F_C]))
    a, b, c = truth[ts.F_C, top - 1 : top + 2]
    peak = b - (a - c) ** 2 / (8.0 * (a - 2.0 * b + c))
    return (
        found.duration_s / contact_s - 1.0,
        peak / rigid_peak_force_n(mass, STIFFNESS, SPEED) - 1.0,
    )


def test_hertz_impact_on_a_rigid_half_space():
    of_time, of_peak = np.abs([hertz_errors(h) for h in STEPS_S]).T
    print("relative error of contact time:", *of_time, "of peak force:", *of_peak)
    # The contact time is found by linear interpolation of the gap within a step.
    assert of_time[0] < 1e-4
    assert of_time[-1] < 1e-6
    # Forces are means over a step, which miss a peak by a few (h w)^2/24, w = pi/T, T = 27 us.
    assert np.all(of_peak < (np.pi * np.array(STEPS_S) / 27e-6) ** 2)
    np.testing.assert_allclose(of_peak[:-1] / of_peak[1:], 4.0, rtol=0.05)


def rebound(restitution: float, step_s: float) -> float:
    d = hunt_crossley_parameter(restitution, SPEED)
    plant = rigid(
        step_s, Contact(STIFFNESS, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=d), speed_m_s=SPEED
    )
    run(plant, round(120e-6 / step_s))  # the longest contact lasts 50 us
    return float(plant.state.body[FLIGHT_V] / SPEED)


@pytest.mark.parametrize("restitution", RESTITUTIONS)
def test_hunt_crossley_rebounds_with_the_restitution_asked_for(restitution):
    errors = [abs(rebound(restitution, h) - restitution) for h in STEPS_S]
    print(f"restitution {restitution}: errors {errors}")
    assert errors[0] < 1e-5
    assert np.divide(errors[:-1], errors[1:]).min() > 10.0  # order 4, but for the ends of contact


@pytest.mark.parametrize("restitution", [1e-6, 0.02, 0.028, 0.03, 0.5, 0.99, 0.999989, 0.999991])
def test_hunt_crossley_parameter_solves_its_equation(restitution):
    x, e = Decimal(hunt_crossley_parameter(restitution, 1.0)), Decimal(restitution)
    loss = 1.0 - restitution
    # The equation's terms cancel to (1 - e)^2 of themselves; its asymptote is good to 1e-5.
    width = Decimal(min(2e-5, 1e-13 + 1e-15 / loss**2))

    def mismatch(at: Decimal) -> Decimal:
        inside = 1 - e * at
        return at - (1 + at).ln() + e * at + inside.ln() if inside > 0 else Decimal(-1)

    with localcontext(prec=60):
        assert mismatch(x * (1 - width)) > 0
        assert mismatch(x * (1 + width)) < 0
    assert hunt_crossley_parameter(restitution, 2.0) == pytest.approx(float(x) / 2.0)


@pytest.mark.parametrize("restitution", [0.0, -0.5, 1.0000001, float("nan"), float("inf")])
def test_impossible_restitutions_are_refused(restitution):
    with pytest.raises(ValueError, match=r"restitution is .*; it must be above 0 and at most 1"):
        hunt_crossley_parameter(restitution, 1.0)


def test_the_faintest_touch_is_a_contact():
    # A sphere laid on the plate sinks by g h^2/2 = 5e-12 m in its first step.
    plant = ModalPlant(spec(loss_factor=0.0))
    plant.state.body[[FLIGHT_X, FLIGHT_V, XI, XI_S]] = 0.0
    rows = run(plant, 50)
    assert np.all(np.diff(rows.xi) < 0.0)
    assert np.all(rows.f_c > 0.0)
