"""The default scheme: order 4 against DOP853, energy to rounding at any step, its spring."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.plant.contact import elastic_kernels as hertz
from hertzloop.plant.contact import elastic_kernels as solve
from hertzloop.plant.contact.hertz import Contact, Damping, hertz_stiffness, hunt_crossley_parameter
from hertzloop.plant.numerics import phi
from hertzloop.plant.schemes.collocation import CollocationPlant, flexibility_m_n
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


@pytest.mark.parametrize("case", CASES)
def test_gap_converges_as_the_fourth_power_of_the_step(case):
    changes, push = CASES[case]
    errors = []
    finest = STEPS_S[-1]
    solution = None
    for h in STEPS_S:
        plant = CollocationPlant(spec(step_s=h, lead_in_s=0.0, **changes))
        found = after_steps(plant, np.full(round(CONTACT_S / h), push))
        if solution is None:
            t = finest * np.arange(1, round(CONTACT_S / finest) + 1)
            solution = reference(plant.spec, lambda _: np.asarray(push), t)
        every = round(h / finest)
        errors.append(abs(found - solution[every - 1 :: every]).max() / -solution.min())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(f"{case}: {len(plant.modes.omega)} frequencies, errors {errors}, orders {orders}")
    assert solution[-1] > 0.0  # a whole contact
    # The end of a damped contact is less smooth: the force does not go to zero there.
    assert orders.mean() > (3.6 if plant.model.viscous_n_s_m == 0.0 else 1.8)
    assert errors[2] < 1e-4


@settings(max_examples=100, deadline=None)
@given(
    st.floats(-8, -3),
    st.floats(-7, -3.5),
    st.floats(0.0, 3.0),
    st.floats(-1.0, 1.0),
    st.sampled_from(["none", "viscous", "hunt_crossley"]),
    st.floats(0.0, 1.0),
)
def test_every_contact_solve_ends_and_closes_its_energy(depth, step, speed, way, damping, share):
    """Random states in contact and about to be, at steps from 0.1 us to 0.3 ms."""
    contact = Contact(
        ALUMINIUM,
        viscous_n_s_m=2.0 if damping == "viscous" else 0.0,
        hunt_crossley_s_m=0.5 if damping == "hunt_crossley" else 0.0,
    )
    what = spec(step_s=10.0**step, contact=contact, limit_hz=8e3)
    plant = CollocationPlant(what)
    model = plant.model._replace(flexibility_m_n=share * 3e-8)
    x0, d0 = -(10.0**depth), -speed * what.step_s
    free_x, free_d = x0 + d0, d0 * way
    before = hertz.elastic(model, x0)[1]
    f0, f1, lost, evaluations, _ = solve.solve_contact(
        model, x0, d0, free_x, free_d, x0 + 0.5 * d0, before, 0.0, 0.0
    )
    g = model.gains
    x1 = free_x + g[solve.X0] * f0 + g[solve.X1] * f1
    mean = x0 + 0.5 * d0 + g[solve.M0] * f0 + g[solve.M1] * f1
    after = hertz.elastic(model, x1)[1]
    work = f0 * (x1 - x0) + f1 * (x1 + x0 - 2.0 * mean)
    size = abs(f0 * (x1 - x0)) + before + after + abs(lost)
    assert abs(work + after - before + lost) <= 1e-9 * size
    assert evaluations <= 150
    if damping == "none":
        assert lost == 0.0


@given(st.floats(1e-12, 1e-3), st.floats(0.0, 1e-6))
def test_spring_in_series_takes_its_share(gap, flexibility):
    model = CollocationPlant(spec(limit_hz=8e3)).model._replace(flexibility_m_n=flexibility)
    y = hertz.root_penetration(model, -gap)
    force = model.stiffness * y**3
    assert y * y + flexibility * force == pytest.approx(gap, rel=1e-13)
    assert hertz.elastic(model, -gap)[0] == pytest.approx(force, rel=1e-13)
    # Energy is the integral of the force over the gap.
    nodes, weights = np.polynomial.legendre.leggauss(40)
    # Substituting gap = u^2 smooths the kink.
    u = math.sqrt(gap) * 0.5 * (nodes + 1.0)
    work = sum(
        w * 2.0 * x * hertz.elastic(model, -x * x)[0] for w, x in zip(weights, u, strict=True)
    )
    assert hertz.elastic(model, -gap)[1] == pytest.approx(0.5 * math.sqrt(gap) * work, rel=1e-6)


def test_modes_left_out_act_as_a_spring():
    """Few modes and the spring come close to many modes, far closer than without."""

    def found(limit_hz: float, *, sprung: bool) -> np.ndarray:
        what = replace(spec(limit_hz=limit_hz), residual_flexibility=sprung)
        return after_steps(CollocationPlant(what), np.zeros(30))

    many, bare, sprung = (
        found(480e3, sprung=True),
        found(125e3, sprung=False),
        found(125e3, sprung=True),
    )
    assert abs(sprung - many).max() < 0.1 * abs(bare - many).max()
    what = replace(spec(limit_hz=125e3), residual_flexibility=True)
    assert flexibility_m_n(what) == pytest.approx(
        what.plate.residual_flexibility_m_n(2 * math.pi * 125e3), rel=0.2
    )


def test_phi_functions():
    x = np.array([1e-9j, 0.3 - 0.2j, 1.0 + 0.0j, 2.5j, -4.0 + 3.0j])
    exact = [np.exp(x), np.expm1(x) / x]
    np.testing.assert_allclose(phi(0, x), exact[0], rtol=1e-15)
    np.testing.assert_allclose(phi(1, x), exact[1], rtol=1e-13)
    for order in (1, 2, 3):  # phi_k = phi_{k+1} x + 1/k!
        np.testing.assert_allclose(
            phi(order, x), phi(order + 1, x) * x + 1.0 / math.factorial(order), rtol=1e-13
        )


@pytest.mark.parametrize("turn", [10.0, 100.0, 500.0])
def test_losses_are_booked_where_modes_turn_far_in_a_step(turn):
    highest = CollocationPlant(spec(loss_factor=0.1)).modes.omega[-1]
    plant = CollocationPlant(spec(loss_factor=0.1, step_s=turn / highest, lead_in_s=0.0))
    after_steps(plant, np.zeros(300))
    balance = plant.close_balance()
    assert balance.modal_dissipated_j > 1e-3 * balance.energy_start_j
    assert abs(balance.energy_residual) < 1e-11
