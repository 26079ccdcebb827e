"""The published scheme: against a plain loop written from the sentences, and its own claims."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.plant.contact.hertz import Contact, Damping, Sphere, hertz_stiffness
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes import thesis2008_kernels as k
from hertzloop.plant.schemes.thesis2008 import ThesisPlant, green_functions, relative_speed_m_s
from hertzloop.plant.state_kernels import NEWTON_MAX, STEP, XI
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate
from tests.plant.rigs import after_steps

THICKNESS = {"aluminium": 0.003, "oak": 0.01, "sylomer_m": 0.0125}
VISCOUS = {"aluminium": 9.41, "oak": 1.6379, "sylomer_m": 0.093915}


def published(material: str = "aluminium", **contact: object) -> PlantSpec:
    plate = MATERIALS[material]
    s = hertz_stiffness(0.02, MATERIALS["steel"], plate)
    damping = {"damping": Damping.VISCOUS, "viscous_n_s_m": VISCOUS[material]}
    return PlantSpec(
        sphere=Sphere(MATERIALS["steel"], 0.02, 0.05),
        plate=Plate(plate, (0.5, 0.5), THICKNESS[material]),
        contact=Contact(s, **(contact or damping)),
        contact_point_m=(0.25, 0.25),
        actuator_point_m=(0.25, 0.25),
        step_s=1e-6,
        frequency_limit_hz=5e5,
        lead_in_s=0.0,
    )


def relaxing(tau_s: float, share: float, *, extra_state: bool) -> PlantSpec:
    stiffness = published().contact.stiffness
    return published(
        damping=Damping.RELAXATION,
        relaxation_stiffness=share * stiffness * tau_s / 34e-6,
        relaxation_s=tau_s,
        extra_state=extra_state,
    )


def plain_run(spec: PlantSpec, f_a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gaps and velocities until the first xi > 0, from the printed relations, by bisection."""
    modes = ThesisPlant(spec, 10).modes
    dt, m, s, c = 1e-6, spec.sphere.mass_kg, spec.contact.stiffness, spec.contact.viscous_n_s_m
    t = np.arange(len(f_a)) * dt
    eta = spec.plate.eta
    delta, theta = eta * modes.omega / 2, modes.omega * math.sqrt(1 - eta**2 / 4)
    weight = spec.plate.modal_scale_per_kg * modes.contact**2
    turn, decay = np.outer(theta, t), np.exp(-np.outer(delta, t))
    g_a = weight @ (
        decay
        * (-(theta - delta**2 / theta)[:, None] * np.sin(turn) - 2 * delta[:, None] * np.cos(turn))
    )
    g_a[0] = 0.0
    alpha = -1 / 3
    gamma, beta = (1 - 2 * alpha) / 2, (1 - alpha) ** 2 / 4
    xi, v, a, force = [0.0], [-spec.sphere.impact_speed_m_s], [-9.81], [f_a[0]]
    for n in range(1, len(f_a)):
        a_p = -dt * sum(g_a[j] * force[n - j] for j in range(1, n + 1))

        def moved(a1: float) -> tuple[float, float]:
            newmark_x = dt * v[-1] + dt**2 * ((0.5 - beta) * a[-1] + beta * a1)
            newmark_v = dt * ((1 - gamma) * a[-1] + gamma * a1)
            return xi[-1] - alpha * newmark_x, v[-1] - alpha * newmark_v

        def wrong(a1: float, a_p: float = a_p) -> float:
            x1, v1 = moved(a1)
            return a1 - (s * max(-x1, 0.0) ** 1.5 - c * v1) / m + 9.81 + a_p

        low, high = -1e9, 1e9
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if wrong(middle) > 0 else (middle, high)
        x1, v1 = moved(low)
        xi.append(x1)
        v.append(v1)
        a.append(low)
        if x1 > 0:
            break
        force.append(-s * (-x1) ** 1.5 + c * v1 + f_a[n])
    return np.array(xi), np.array(v)


@pytest.mark.parametrize("push", [0.0, 25.0])
def test_against_a_plain_loop(push):
    f_a = push * np.sin(np.arange(200) / 9.0)
    xi, v = plain_run(published(), f_a)
    plant = ThesisPlant(published(), 200)
    got = np.append(0.0, after_steps(plant, f_a[: len(xi) - 1]))
    assert len(xi) > 30
    # Newton stops at |da| < 1e-6 m/s^2, some 1e-10 of the accelerations met.
    np.testing.assert_allclose(got, xi, rtol=0, atol=1e-8 * np.abs(xi).max())
    assert plant.state.motion[k.REL_V] == pytest.approx(v[-1], rel=1e-8)
    speed = relative_speed_m_s(got, plant.spec.sphere.impact_speed_m_s, 1e-6)
    assert speed == pytest.approx(float(plant.state.motion[k.REL_V]), rel=1e-9)


def test_green_functions_are_derivatives_of_each_other():
    plant = ThesisPlant(published("oak"), 10)
    fine = 1e-9
    x, v, a = green_functions(plant.spec.plate, plant.modes, fine, 600)
    assert a[0] == 0.0
    np.testing.assert_allclose(np.gradient(x, fine)[1:-1], v[1:-1], rtol=0, atol=1e-4 * v.max())
    middle = np.gradient(v, fine)[2:-1]
    np.testing.assert_allclose(middle, a[2:-1], rtol=0, atol=1e-4 * np.abs(a).max())


def first_contact(plant: ThesisPlant) -> tuple[int, float]:
    """Samples of the first contact, from that at xi = 0 to the first one after its end, and the
    relative velocity there."""
    state = plant.state
    while not (state.counts[k.TOUCHING] and state.body[XI] > 0.0):
        k.step(plant.model, state, 0.0)
    return int(state.counts[STEP] - state.counts[k.BEGAN]) + 1, float(state.motion[k.REL_V])


@pytest.mark.parametrize(
    ("material", "published_steps", "allowed"),
    [("aluminium", 35, 0.01), ("oak", 177, 0.05), ("sylomer_m", 698, 0.05)],
)
def test_contact_time_without_control(material, published_steps, allowed):
    plant = ThesisPlant(published(material), 2000)
    samples, speed = first_contact(plant)
    assert plant.state.counts[NEWTON_MAX] <= 3
    assert abs(samples + 1 - published_steps) <= allowed * published_steps
    target = MATERIALS[material].restitution
    assert speed / 0.9904544 == pytest.approx(target, abs=0.003)


@pytest.mark.parametrize("tau_s", [2.5e-3, 2e-5])
def test_memory_as_one_state_is_the_published_sum(tau_s):
    gaps = []
    for extra_state in (False, True):
        plant = ThesisPlant(relaxing(tau_s, 0.4, extra_state=extra_state), 100)
        gaps.append([])
        while not plant.state.body[XI] > 0.0:
            k.step(plant.model, plant.state, 0.0)
            gaps[-1].append(float(plant.state.body[XI]))
    np.testing.assert_allclose(gaps[0], gaps[1], rtol=0, atol=1e-12 * np.abs(gaps[0]).max())
    assert len(gaps[0]) >= 34  # without damping 33


@pytest.mark.full
def test_flight_and_next_impact():
    plant = ThesisPlant(replace(published(), lead_in_s=1e-4), 200_000)
    starts, touching = [], False
    for _ in range(200_000):
        k.step(plant.model, plant.state, 0.0)
        now = bool(plant.state.counts[k.TOUCHING])
        if now and not touching:
            starts.append((int(plant.state.counts[STEP]), -float(plant.state.motion[k.REL_V])))
        touching = now
    assert starts[0] == (100, pytest.approx(0.99045444, rel=1e-8))
    speed = starts[1][1]
    flight_s = (starts[1][0] - starts[0][0]) * 1e-6
    assert flight_s == pytest.approx(2 * speed / 9.81, abs=4e-5)  # and the contact before


def test_the_balance_shows_that_momentum_is_not_conserved():
    plant = ThesisPlant(published(), 200)
    after_steps(plant, np.zeros(100))
    balance = plant.close_balance()
    assert balance.contact_impulse_n_s == pytest.approx(1.12e-3, rel=0.01)
    assert balance.momentum_change_n_s == pytest.approx(0.4408, rel=0.01)
    assert abs(balance.momentum_residual) > 0.5


def test_what_the_published_scheme_does_not_know():
    with pytest.raises(ValueError, match="contact point only"):
        ThesisPlant(replace(published(), actuator_point_m=(0.2, 0.25)), 10)
    contact = Contact(1e10, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=0.1)
    with pytest.raises(ValueError, match="hunt_crossley"):
        ThesisPlant(replace(published(), contact=contact), 10)
