"""The infinite plate: Zener's equation at order 4, balance to rounding, modes of a big plate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    hertz_stiffness,
    hunt_crossley_parameter,
)
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant, impedance_n_s_m
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.materials import MATERIALS
from tests.plant.rigs import after_steps, spec

STIFFNESS = hertz_stiffness(0.003, MATERIALS["steel"], MATERIALS["aluminium"])
CONTACTS = {
    "undamped": Contact(STIFFNESS),
    "viscous": Contact(STIFFNESS, Damping.VISCOUS, viscous_n_s_m=2.0),
    "hunt_crossley": Contact(
        STIFFNESS, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=hunt_crossley_parameter(0.6, 1.0)
    ),
}
# Where damping ends with the contact the force is less smooth.
ORDERS = {"undamped": 3.6, "viscous": 2.5, "hunt_crossley": 3.3}


def endless(**changes) -> PlantSpec:
    """An infinite plate."""
    return replace(spec(**changes), infinite_plate=True)


def zener(what: PlantSpec, push_n: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gap and sphere velocity by Zener's equation, with contact damping and an actuator."""
    contact, mass = what.contact, what.sphere.mass_kg
    z = impedance_n_s_m(what.plate)

    def slope(_: float, y: np.ndarray) -> list[float]:
        sphere, speed, plate = y
        spring = contact.stiffness * max(plate - sphere, 0.0) ** 1.5
        damper = contact.viscous_n_s_m + contact.hunt_crossley_s_m * spring
        damper *= plate > sphere
        plate_speed = (push_n - spring + damper * speed) / (z + damper)
        force = spring - damper * (speed - plate_speed)
        return [speed, force / mass - GRAVITY_M_S2, plate_speed]

    start = [0.0, -what.sphere.impact_speed_m_s, 0.0]
    done = solve_ivp(
        slope,
        (0.0, times[-1] * (1.0 + 1e-12)),
        start,
        "DOP853",
        times,
        rtol=1e-12,
        atol=1e-18,
        max_step=2e-7,
    )
    return done.y[0] - done.y[2], done.y[1]


@pytest.mark.parametrize("push_n", [0.0, 20.0])
@pytest.mark.parametrize("name", CONTACTS)
def test_zeners_equation_at_order_four(name, push_n):
    steps_s = (4e-6, 2e-6, 1e-6, 5e-7)
    what = endless(contact=CONTACTS[name], lead_in_s=0.0)
    times = 5e-7 * np.arange(1, 81)
    gap, speed = zener(what, push_n, times)
    assert gap[-1] > 0.0  # a whole contact
    errors = []
    for h in steps_s:
        every = round(h / 5e-7)
        plant = ModalPlant(replace(what, step_s=h))
        found = after_steps(plant, np.full(80 // every, push_n))
        errors.append(abs(found - gap[every - 1 :: every]).max() / -gap.min())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(f"{name}: errors {errors}, orders {orders}")
    assert errors[2] < 3e-6
    assert orders.mean() > ORDERS[name]
    # Restitution, at the smallest step.
    restitution = plant.sphere_speed_m_s() / what.sphere.impact_speed_m_s
    assert abs(restitution - speed[-1] / what.sphere.impact_speed_m_s) < 1e-6
    assert 0.3 < restitution < 0.95


@pytest.mark.parametrize(
    ("material", "loss_factor", "thickness_m", "limit_hz", "steps"),
    [
        ("aluminium", 0.0, 0.01, 490e3, 100),
        ("oak", 0.05, 0.01, 200e3, 700),
        ("sylomer_m", 0.16, 0.0125, 30e3, 4000),
    ],
)
def test_the_modes_of_a_big_plate_agree(material, loss_factor, thickness_m, limit_hz, steps):
    """Damped plates, too: there the impedance without damping is wrong by far more."""
    what = spec(
        material=material, thickness_m=thickness_m, loss_factor=loss_factor, limit_hz=limit_hz
    )
    modal = ModalPlant(replace(what, residual_flexibility=True))
    gap = after_steps(modal, np.zeros(steps))
    without_edges = replace(what, infinite_plate=True)
    found = after_steps(ModalPlant(without_edges), np.zeros(steps))
    assert gap[-1] > 0.0
    error = abs(found - gap).max() / -gap.min()
    assert error < 1e-3
    undamped = replace(without_edges, plate=replace(what.plate, loss_factor=0.0))
    plain = after_steps(ModalPlant(undamped), np.zeros(steps))
    if loss_factor:
        assert abs(plain - gap).max() / -gap.min() > 10.0 * error


def test_impedance():
    plate = spec(loss_factor=0.0).plate
    assert impedance_n_s_m(plate) == pytest.approx(
        8.0 * math.sqrt(plate.bending_stiffness_n_m * plate.mass_per_area_kg_m2), rel=1e-15
    )
    # 1/Z of a damped plate: the modal sum of a far larger plate's impulse response.
    damped = replace(plate, loss_factor=0.1)
    c = math.sqrt(1.0 - 0.1**2 / 4.0)
    x = np.linspace(1e-6, 400.0, 4_000_001)  # omega t
    integral = np.trapezoid(np.exp(-0.05 * x) * np.sin(c * x) / (c * x), x)
    ratio = impedance_n_s_m(plate) / impedance_n_s_m(damped)
    assert ratio == pytest.approx(2.0 / math.pi * integral, rel=1e-5)


def test_an_actuator_elsewhere_is_refused():
    with pytest.raises(ValueError, match="contact point only"):
        ModalPlant(endless(actuator_point_m=(0.2, 0.2)))
