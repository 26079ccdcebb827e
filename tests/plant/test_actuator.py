"""The actuator: its response against closed forms, and its mass two ways."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from hertzloop.plant.actuator import IDEAL, Actuator, build_model
from hertzloop.plant.actuator_kernels import force
from hertzloop.plant.plant import modes_of
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.state_kernels import ACTUATOR_F, BODY_SIZE
from tests.plant.rigs import after_steps, spec

H = 1e-6
BESIDE = {"size_m": (0.3, 0.2), "contact_point_m": (0.11, 0.07), "actuator_point_m": (0.13, 0.07)}


def step_response(t: np.ndarray, bandwidth_hz: float, zeta: float) -> np.ndarray:
    """1 - (s2 e^(s1 t) - s1 e^(s2 t))/(s2 - s1) by the roots of s^2 + 2 zeta w s + w^2."""
    w = 2.0 * math.pi * bandwidth_hz
    if zeta == 1.0:
        return np.asarray(1.0 - np.exp(-w * t) * (1.0 + w * t))
    root = cmath.sqrt(zeta * zeta - 1.0)
    s1, s2 = w * (-zeta + root), w * (-zeta - root)
    return np.asarray(1.0 - ((s2 * np.exp(s1 * t) - s1 * np.exp(s2 * t)) / (s2 - s1)).real)


@pytest.mark.parametrize("zeta", [0.05, 0.3, 0.7, 1.0, 2.5])
@pytest.mark.parametrize("bandwidth_hz", [1e3, 3e4, 3e5, 3e6])
def test_step_response_is_the_closed_form(bandwidth_hz, zeta):
    model = build_model(Actuator(bandwidth_hz, zeta), H)
    body = np.zeros(BODY_SIZE)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    for k in range(40):
        mean, slope = force(model, body, 1.0)
        t = H * (k + 0.5 + 0.5 * nodes)
        exact = step_response(t, bandwidth_hz, zeta)
        assert mean == pytest.approx(0.5 * weights @ exact, abs=1e-12)
        assert slope == pytest.approx(1.5 * weights @ (nodes * exact), abs=1e-12)
        end = step_response(np.array([H * (k + 1)]), bandwidth_hz, zeta)[0]
        assert body[ACTUATOR_F] == pytest.approx(end, abs=1e-12)


def test_an_actuator_at_rest_stays_at_rest_and_comes_to_rest():
    model = build_model(Actuator(1e5, force_limit_n=50.0), H)
    body = np.zeros(BODY_SIZE)
    assert force(model, body, 0.0) == (0.0, 0.0)
    force(model, body, 80.0)
    found = [force(model, body, 0.0) for _ in range(200)]
    assert abs(found[0][0]) > 1.0
    assert found[-1] == (0.0, 0.0)


def test_force_is_limited_at_both_ends_of_every_step():
    random = np.random.default_rng(5)
    model, body = build_model(Actuator(2e5, 0.3, force_limit_n=10.0), H), np.zeros(BODY_SIZE)
    found = np.array([force(model, body, c) for c in 30.0 * random.standard_normal(500)])
    ends = np.concatenate([found[:, 0] - found[:, 1], found[:, 0] + found[:, 1]])
    assert abs(ends).max() == pytest.approx(10.0, rel=1e-15)
    assert np.count_nonzero(abs(ends) == abs(ends).max()) > 100
    held = build_model(Actuator(force_limit_n=10.0), H)
    assert [force(held, body, c)[0] for c in (-30.0, 4.0, 11.0)] == [-10.0, 4.0, 10.0]


def gaps(what: object, push: np.ndarray) -> tuple[ModalPlant, np.ndarray]:
    plant = ModalPlant(what)
    return plant, after_steps(plant, push)


@pytest.mark.full
def test_a_large_bandwidth_is_the_ideal_actuator():
    """What is left is the delay of 2 zeta/w: a hundredth of it with 100 times the bandwidth."""
    assert build_model(IDEAL, H).at_once
    push = np.where(np.arange(60) % 20 < 10, 30.0, -10.0)
    for beside in ({}, BESIDE):
        what = replace(spec(**beside), residual_flexibility=True)
        _, ideal = gaps(what, push)
        fast, faster = (
            abs(gaps(replace(what, actuator=Actuator(f)), push)[1] - ideal).max()
            for f in (1e7, 1e9)
        )
        assert faster < 0.02 * fast
        assert faster < 2e-5 * abs(ideal).max()


def test_mass_loaded_modes_without_a_spring_are_those_of_the_matrices():
    what = replace(spec(actuator_point_m=(0.3, 0.21)), residual_flexibility=False)
    bare, scale = modes_of(what), what.plate.modal_scale_per_kg
    loaded = modes_of(replace(what, actuator=Actuator(mass_kg=1e-3)))
    mass = np.eye(len(bare.omega)) / scale + 1e-3 * np.outer(bare.actuator, bare.actuator)
    squared = eigh(np.diag(bare.omega**2 / scale), mass, eigvals_only=True)
    assert loaded.omega == pytest.approx(np.sqrt(squared), rel=1e-7)


@pytest.mark.parametrize("point", [None, (0.3, 0.21), (0.2, 0.25)])
@pytest.mark.parametrize("mass_kg", [1e-4, 1e-2, 10.0])
def test_mass_loaded_modes_are_those_of_the_matrices(point, mass_kg):
    """With the modes left out as a spring between mass and plate."""
    what = replace(spec(actuator_point_m=point), residual_flexibility=True)
    bare, scale = modes_of(what), what.plate.modal_scale_per_kg
    loaded = modes_of(replace(what, actuator=Actuator(mass_kg=mass_kg)))
    omega_max = 2.0 * math.pi * what.frequency_limit_hz
    spring = what.plate.residual_flexibility_m_n(omega_max, what.actuator_point_m)
    n = len(bare.omega)
    relative = np.append(bare.actuator, -1.0)
    stiffness = np.diag(np.append(bare.omega**2 / scale, 0.0))
    stiffness += np.outer(relative, relative) / spring
    squared, shapes = eigh(stiffness, np.diag(np.append(np.ones(n) / scale, mass_kg)))
    at_actuator = shapes[n] / math.sqrt(scale)
    at_contact = shapes[:n].T @ bare.contact / math.sqrt(scale) if point else at_actuator
    assert loaded.omega == pytest.approx(np.sqrt(squared), rel=1e-7)
    assert scale * np.sum(loaded.actuator**2) == pytest.approx(1.0 / mass_kg, rel=1e-12)
    rank = np.argsort(np.abs(loaded.actuator))[-20:]
    assert np.abs(loaded.actuator[rank]) == pytest.approx(np.abs(at_actuator[rank]), rel=1e-6)
    products = (loaded.contact * loaded.actuator)[rank]
    assert products == pytest.approx((at_contact * at_actuator)[rank], rel=1e-5, abs=1e-9)
