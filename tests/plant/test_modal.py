"""The default scheme: order 4 against DOP853, energy and momentum to rounding at any step."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from hertzloop.closed_loop.parts import series_under
from hertzloop.plant.actuator import IDEAL, Actuator
from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    Limit,
    hertz_stiffness,
    hunt_crossley_parameter,
)
from hertzloop.plant.plant import Balance, Plant
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.structures.materials import MATERIALS
from tests.plant.rigs import after_steps, spec
from tests.plant.test_solution import reference

STEPS_S = (4e-6, 2e-6, 1e-6, 5e-7)
CONTACT_S = 40e-6
ALUMINIUM = hertz_stiffness(0.003, MATERIALS["steel"], MATERIALS["aluminium"])
HUNT_CROSSLEY = Contact(
    ALUMINIUM, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=hunt_crossley_parameter(0.6, 1.0)
)
VISCOUS = Contact(ALUMINIUM, Damping.VISCOUS, viscous_n_s_m=2.0)
BESIDE = {
    "size_m": (0.3, 0.2),
    "contact_point_m": (0.11, 0.07),
    "actuator_point_m": (0.13, 0.07),
    "loss_factor": 0.02,
}
CASES: dict[str, tuple[dict, float]] = {
    "undamped": ({"loss_factor": 0.0}, 0.0),
    "damped plate and contact": ({"loss_factor": 0.1, "contact": HUNT_CROSSLEY}, 0.0),
    "viscous": ({"contact": VISCOUS}, 0.0),
    "constant force": ({}, 20.0),
    "constant force beside, off centre": (BESIDE, -30.0),
}


def errors_of(scheme: type[Plant], case: str, steps_s: tuple[float, ...]) -> np.ndarray:
    """Largest error of the gap over a whole contact at each step, as a share of the penetration."""
    changes, push = CASES[case]
    errors = []
    finest = steps_s[-1]
    t = finest * np.arange(1, round(CONTACT_S / finest) + 1)
    solution = reference(spec(**changes), lambda _: np.asarray(push), t)
    assert solution[-1] > 0.0
    for h in steps_s:
        plant = scheme(spec(step_s=h, lead_in_s=0.0, **changes))
        found, every = after_steps(plant, np.full(round(CONTACT_S / h), push)), round(h / finest)
        errors.append(abs(found - solution[every - 1 :: every]).max() / -solution.min())
    print(f"{case}: {len(plant.modes.omega)} frequencies, errors {errors}")
    return np.array(errors)


@pytest.mark.parametrize("case", CASES)
def test_gap_converges_as_the_fourth_power_of_the_step(case):
    errors = errors_of(ModalPlant, case, STEPS_S)
    # The end of a damped contact is less smooth: the force does not go to zero there.
    assert np.log2(errors[:-1] / errors[1:]).mean() > (1.8 if case == "viscous" else 3.6)
    assert errors[2] < 1e-4


SPRING = {"residual_flexibility": True}
POLE = SPRING | {"damped_residual": True}


@pytest.mark.parametrize("left_out", [SPRING, POLE])
def test_gap_converges_with_what_stands_for_the_modes_left_out(left_out):
    """Order 4 also with a damper, whose force takes its part of the velocity at once."""
    gaps = []
    for step_s in (2e-6, 1e-6, 5e-7, 1.25e-7):
        what = spec(limit_hz=125e3, contact=HUNT_CROSSLEY, step_s=step_s, lead_in_s=0.0)
        plant = ModalPlant(replace(what, **left_out))
        every = round(2e-6 / step_s)
        gaps.append(series_under(plant, np.zeros(19 * every + 1))[0, ::every][:19])
    errors = [float(np.abs(g - gaps[-1]).max() / -gaps[-1].min()) for g in gaps[:-1]]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(errors, orders)
    assert orders.max() > 3.0
    assert errors[1] < 3e-5


def closed(plant: ModalPlant) -> Balance:
    """The balance of a run, which closes."""
    balance = plant.close_balance()
    assert abs(balance.energy_residual) < 1e-11
    assert abs(balance.momentum_residual) < 1e-11
    return balance


# Ideal, with a limit, with a mass, slow, and with all of it.
ACTUATORS = (
    IDEAL,
    Actuator(force_limit_n=15.0),
    Actuator(mass_kg=3e-3),
    Actuator(5e3, 0.3, force_limit_n=8.0),
    Actuator(1e5, 0.3, mass_kg=1e-3, force_limit_n=40.0),
)


@example(  # a step that ends where the contact begins, at the dent of the one before
    step=-3.6484375,
    height=0.0,
    contact=Contact(ALUMINIUM, viscous_n_s_m=2.0, limit=Limit(0.5e9, 0.003)),
    actuator=ACTUATORS[3],
    hold=40,
    left_out=POLE,
    beside=False,
    seed=483,
)
@settings(max_examples=200, deadline=None)
@given(
    step=st.floats(-7.0, -3.5),
    height=st.floats(-5.0, 0.0),
    contact=st.sampled_from(
        [
            Contact(ALUMINIUM),
            VISCOUS,
            HUNT_CROSSLEY,
            Contact(ALUMINIUM, limit=Limit(0.5e9, 0.003)),
            Contact(ALUMINIUM, viscous_n_s_m=2.0, limit=Limit(0.5e9, 0.003)),
            replace(HUNT_CROSSLEY, limit=Limit(0.5e9, 0.003)),
        ]
    ),
    actuator=st.sampled_from(ACTUATORS),
    hold=st.sampled_from([1, 40]),
    left_out=st.sampled_from([{}, SPRING, POLE, {"infinite_plate": True}]),
    beside=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_energy_is_kept_whatever_the_step(
    step, height, contact, actuator, hold, left_out, beside, seed
):
    """Steps from 0.1 us to 0.3 ms, from less than a mode's period to more than a contact."""
    assume(not (actuator.mass_kg and "infinite_plate" in left_out))
    point = (0.3, 0.21) if beside and "infinite_plate" not in left_out else None
    what = spec(
        step_s=10.0**step,
        drop_height_m=10.0**height,
        contact=contact,
        limit_hz=8e3,
        actuator_point_m=point,
        loss_factor=0.02,
    )
    plant = ModalPlant(replace(what, **left_out, actuator=actuator))
    random = np.random.default_rng(seed)
    pushes = 60.0 * random.standard_normal(300) * (random.random(300) < 0.3)
    series_under(plant, np.repeat(pushes, hold)[:1000])
    balance = closed(plant)
    assume(balance.contact_steps > 0)  # a push may take the plate away from a slow sphere
    assert balance.modal_dissipated_j > 0.0
    assert (balance.contact_dissipated_j > 0.0) == contact.has_damper
    if contact.limit is None:
        assert balance.plastic_dissipated_j == 0.0


def test_steps_that_newton_does_not_solve_are_counted_and_conserve():
    """A contact of 30 us in steps of 20 us to 2 ms."""
    counted = []
    for step_us in (1.0, 20.0, 200.0, 2000.0):
        balance_of = []
        for contact in (Contact(ALUMINIUM), HUNT_CROSSLEY, VISCOUS):
            what = spec(step_s=step_us * 1e-6, contact=contact, limit_hz=8e3)
            plant = ModalPlant(replace(what, residual_flexibility=True))
            after_steps(plant, np.zeros(3000))
            balance_of.append(closed(plant))
        counted.append(sum(b.newton_fallbacks for b in balance_of))
        assert all(b.contact_steps > b.newton_fallbacks for b in balance_of)
        assert all(b.newton_iterations_max <= 16 for b in balance_of)
    print(counted)
    assert counted[0] == 0
    assert counted[-1] > 0


@pytest.mark.parametrize("turn", [10.0, 100.0, 500.0])
def test_losses_are_booked_where_modes_turn_far_in_a_step(turn):
    highest = ModalPlant(spec(loss_factor=0.1)).modes.omega[-1]
    plant = ModalPlant(spec(loss_factor=0.1, step_s=turn / highest, lead_in_s=0.0))
    after_steps(plant, np.zeros(300))
    balance = closed(plant)
    assert balance.modal_dissipated_j > 1e-3 * balance.energy_start_j
