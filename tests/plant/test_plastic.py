"""A contact that yields: closed forms, order, balance at any step, a spot struck again."""

import math

import numpy as np
import pytest

from hertzloop.plant.contact.hertz import Contact, Limit, hertz_stiffness
from hertzloop.plant.contact.yielding import dent_now_m, elastic_n, yielding
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.registry import step
from hertzloop.plant.state_kernels import (
    DEEPEST,
    FLIGHT_STEP,
    FLIGHT_V,
    FLIGHT_X,
    PLASTIC_DISSIPATED,
    STEP,
    XI,
    XI_S,
)
from hertzloop.plant.structures.materials import MATERIALS
from tests.plant.rigs import IMMOVABLE, after_steps, spec

RADIUS = 0.003
STIFFNESS = hertz_stiffness(RADIUS, MATERIALS["steel"], MATERIALS["aluminium"])
MODULUS = 0.75 * STIFFNESS / math.sqrt(RADIUS)


def soft(pressure_pa: float, stiffness: float = STIFFNESS, **damping: float) -> Contact:
    radius = (0.75 * stiffness / MODULUS) ** 2
    return Contact(stiffness, **damping, limit=Limit(pressure_pa, radius))


def dent_of(plant: ModalPlant) -> float:
    return dent_now_m(plant.spec.contact, plant.state.body[DEEPEST])


def moved(what: PlantSpec, steps: int) -> ModalPlant:
    plant = ModalPlant(what)
    after_steps(plant, np.zeros(steps))
    return plant


@pytest.mark.parametrize(
    ("pressure_pa", "restitution"),
    [(0.35e9, 0.38542), (0.7e9, 0.59077), (1.05e9, 0.75072), (1.5e9, 0.90537), (2.1e9, 0.99998)],
)
def test_restitution_of_a_massive_body(pressure_pa, restitution):
    contact = soft(pressure_pa)
    plant = moved(spec(contact=contact, material=IMMOVABLE), 80)
    speed = plant.spec.sphere.impact_speed_m_s
    law = yielding(Limit(pressure_pa, RADIUS), STIFFNESS)
    mass = plant.spec.sphere.mass_kg
    q = math.sqrt(2.0 * law.energy_j / mass) / speed  # v_y: the energy of first yield
    formula = math.sqrt(1.2 * math.sqrt(3.0)) * math.sqrt(1.0 - q * q / 6.0)
    formula *= (q / (q + 2.0 * math.sqrt(1.2 - q * q / 5.0))) ** 0.25
    assert formula == pytest.approx(restitution, abs=1e-5)
    found = plant.state.body[FLIGHT_V] / speed
    assert found == pytest.approx(restitution, abs=1e-4)
    balance = plant.close_balance()
    assert balance.dent_m > 0.0
    lost = 0.5 * mass * speed**2 * (1.0 - restitution**2)
    assert balance.plastic_dissipated_j == pytest.approx(lost, rel=1e-3, abs=2e-8)


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("pressure_pa", [0.44e9, 1.05e9])
def test_gap_converges_with_the_step(pressure_pa, damping):
    """Order 3 at least: where the law changes within a step its curvature or slope jumps."""
    contact = soft(pressure_pa, hunt_crossley_s_m=damping)
    places = []
    for h in (4e-6, 1e-6, 2.5e-7, 6.25e-8):
        what = spec(step_s=h, contact=contact, limit_hz=60e3, loss_factor=0.0, lead_in_s=0.0)
        plant, every = ModalPlant(what), round(4e-6 / h)
        places.append(after_steps(plant, np.zeros(12 * every))[every - 1 :: every])
    deepest = -places[-1].min()
    errors = [abs(p - places[-1]).max() / deepest for p in places[:-1]]
    orders = np.log2(np.divide(errors[:-1], errors[1:])) / 2.0
    print(errors, orders)
    assert orders.mean() > 3.0
    assert errors[1] < 5e-6
    assert places[-1][-1] > -dent_of(plant)  # a whole contact


def test_a_spot_struck_again_less_hard_is_elastic_about_its_dent():
    contact = soft(0.7e9)
    plant = moved(spec(contact=contact, material=IMMOVABLE, step_s=2.5e-7), 320)
    body, model = plant.state.body, plant.model
    deepest, dent, taken = body[DEEPEST], dent_of(plant), plant.state.balance[PLASTIC_DISSIPATED]
    assert dent > 1e-6
    # Sent down again, with less than what the first impact gave back.
    sent = -0.9 * body[FLIGHT_V]
    counts = plant.state.counts
    body[[FLIGHT_X, XI_S]] = 1e-7 - dent
    body[FLIGHT_V], counts[FLIGHT_STEP] = sent, counts[STEP]
    lowest, most = 0.0, 0.0
    for _ in range(400):
        most = max(most, step(model, plant.state, 0.0))
        lowest = min(lowest, body[XI])
    assert body[DEEPEST] == deepest
    assert plant.state.balance[PLASTIC_DISSIPATED] == taken
    assert body[FLIGHT_V] == pytest.approx(-sent, rel=2e-5)
    at = elastic_n(contact, np.array([-lowest]), np.array([deepest]))[0]
    assert most == pytest.approx(at, rel=5e-4)  # the mean of a step, not its peak
    assert -lowest > dent
