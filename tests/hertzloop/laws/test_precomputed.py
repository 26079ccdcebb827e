"""Pre-computed forces: their shapes, where they start, and the force of the mobility model."""

import numpy as np
import pytest

from hertzloop.controller.laws.precomputed import SHAPES, mobility_force_n, shaped
from hertzloop.loop.simulate import simulate
from hertzloop.scene.controller import law_context, loaded_law
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.uncontrolled import uncontrolled_force_n
from tests.tiers import default

PRECOMPUTED = ["controller.law=precomputed", "controller.kappa=0.4"]


def profile_of(scene: Setup) -> np.ndarray:
    """Forces that the scene's law plays, N, one a sample."""
    about = law_context(scene)
    profile: np.ndarray = loaded_law(scene).constants(scene.scene.controller.keys, about).profile
    return profile


def test_thirteen_forces():
    assert list(SHAPES) == [f"F_a{i}" for i in range(1, 14)]
    contact = np.array([0.0, 1.0, 4.0, 2.0])
    np.testing.assert_allclose(shaped("constant", -0.5, contact), [-2.0] * 4)
    np.testing.assert_allclose(shaped("contact_force", 2.0, contact), 2 * contact)
    np.testing.assert_allclose(shaped("sine", 1.0, contact), [0, 1, 0, -2], atol=1e-12)
    np.testing.assert_allclose(shaped("cosine", 1.0, contact), [0, 0, -4, 0], atol=1e-12)


@pytest.mark.parametrize(
    "source", default(["thesis-aluminium", "aluminium-3mm"], ["aluminium-3mm"])
)
@pytest.mark.parametrize("delay", [0, 5])
def test_force_in_the_loop_is_the_shifted_contact_force(source, delay):
    settings = [
        *PRECOMPUTED,
        "run.duration_s=0.0015",
        f"controller.delay_us={delay}",
        "controller.lead_us=1",
    ]
    scene = load(source, settings)
    contact = uncontrolled_force_n(scene)
    rows = simulate(scene).truth
    start = int(np.flatnonzero(rows[0] <= 0.0)[0])
    acted = rows[5, start + delay : start + delay + len(contact)]
    np.testing.assert_array_equal(acted[1:], 0.4 * contact[1:])
    assert len(contact) > 25


@pytest.mark.full
def test_uncontrolled_force_in_the_published_scheme_is_without_damping():
    contact = uncontrolled_force_n(load("thesis-aluminium"))
    rows = simulate(load("thesis-aluminium", ["controller.law=off"])).truth
    s = load("thesis-aluminium").plant.contact.stiffness
    np.testing.assert_allclose(contact, s * np.maximum(-rows[0, : len(contact)], 0) ** 1.5)


@pytest.mark.parametrize("source", ["aluminium-3mm", "sylomer-20mm"])
def test_mobility_force_solves_its_equation(source):
    scene = load(source, ["run.step_ns=1000"])
    spec = scene.plant
    force, h = mobility_force_n(law_context(scene)), scene.run.step_s
    slope, bend = np.gradient(force, h), np.gradient(np.gradient(force, h), h)
    m, v = spec.sphere.mass_kg, spec.sphere.impact_speed_m_s
    from hertzloop.plant.contact.hertz import rigid_contact_time_s

    spring = m * (np.pi / rigid_contact_time_s(m, spec.contact.stiffness, v)) ** 2
    z = spec.plate.infinite_plate_impedance_n_s_m
    middle = slice(3, -3)
    wrong = bend + spring / z * slope + spring / m * force
    assert np.abs(wrong[middle]).max() < 0.02 * np.abs(spring / m * force).max()
    assert force[0] == 0.0
    assert force[1] / h == pytest.approx(spring * v, rel=0.1)
