"""When reflections matter: image sources against modes, and what they are expected to change."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import sici

from hertzloop.plant.estimates.reflections import Actuation, images, reflections
from hertzloop.plant.estimates.reflections_kernels import (
    add_twice_integrated,
    sine_and_cosine_integral,
)
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import oscillators
from tests.plant.rigs import spec


def twice_integrated(t: np.ndarray, r4a: float) -> tuple[np.ndarray, np.ndarray]:
    once, twice = np.zeros_like(t), np.zeros_like(t)
    add_twice_integrated(t, r4a, 1.0, once, twice)
    return once, twice


def test_integrals_of_a_distant_points_response():
    t = np.linspace(1e-6, 3.0, 1_000_001)
    now = 1.0 - 2.0 / math.pi * sici(2.0 / t)[0]
    step = t[1] - t[0]
    expected = np.cumsum(0.5 * (now[1:] + now[:-1])) * step
    once, twice = twice_integrated(t, 2.0)
    np.testing.assert_allclose(once[1:], expected, atol=1e-6)
    expected_twice = np.cumsum(0.5 * (once[1:] + once[:-1])) * step
    np.testing.assert_allclose(twice[1:], expected_twice, atol=1e-6)


@pytest.mark.parametrize("point", [(0.25, 0.25), (0.11, 0.2), (0.04, 0.05)])
def test_images_and_modes_give_the_same_response(point):
    """Displacement by a force that rises with time: smooth enough to end the sum over modes."""
    plate = Plate(spec().plate.material, (0.5, 0.4), 0.003, 0.0)
    a = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    squared, signs = images(plate.size_m, point)
    t = np.linspace(0.2, 0.5, 20) * squared.min() / (4.0 * a)
    by_images = t * t / 2.0
    for r2, sign in zip(squared, signs, strict=True):
        by_images = by_images + sign * twice_integrated(t, r2 / (4.0 * a))[1]
    by_images /= plate.infinite_plate_impedance_n_s_m
    modes = oscillators(plate, point, point, 2.0 * math.pi * 1e6)
    w, turn = modes.omega, np.outer(t, modes.omega)
    weights = plate.modal_scale_per_kg * modes.contact**2 / w**3
    by_modes = (turn - np.sin(turn)) @ weights  # response to the force t
    # Images farther off than those kept, and modes above the limit, are left out.
    np.testing.assert_allclose(by_images, by_modes, rtol=2e-2)
    without = t * t / 2.0 / plate.infinite_plate_impedance_n_s_m
    assert abs(by_images - by_modes).max() < 0.1 * abs(without - by_modes).max()


def test_errors_rise_with_time_and_fall_with_the_distance_of_the_edge():
    what = spec()

    def lasts(point: tuple[float, float], size: tuple[float, float]) -> float:
        plate = replace(what.plate, size_m=size)
        return reflections(what.sphere, plate, what.contact, point).lasts_s(1e-3, 1e-6)

    central = lasts((0.25, 0.25), (0.5, 0.5))
    assert 0.0 < lasts((0.1, 0.25), (0.5, 0.5)) < central < lasts((0.5, 0.5), (1.0, 1.0))
    found = reflections(what.sphere, what.plate, what.contact, what.contact_point_m)
    assert np.all(np.diff(found.gap) >= 0.0)
    assert 25e-6 < found.contact_s < 35e-6
    assert found.error(1.0, 1e-6) == math.inf
    at = found.error(central, 1e-6)
    assert at <= 1e-3
    # Control, jumps and long steps cost more.
    assert found.error(central, 1e-6, Actuation(0.8, 1e-4)) > at
    assert found.error(central, 1e-6, Actuation(jumps_n=10.0)) > at
    assert found.error(central, 5e-6) > at


def test_nothing_is_promised_where_the_contact_is_at_the_edge_or_does_not_end():
    near = spec(contact_point_m=(0.001, 0.25))
    found = reflections(near.sphere, near.plate, near.contact, near.contact_point_m)
    assert found.lasts_s(1e-3, 1e-6) == 0.0
    assert found.error(1e-6, 1e-6) == math.inf
    heavy = spec(radius_m=0.02)
    found = reflections(heavy.sphere, heavy.plate, heavy.contact, heavy.contact_point_m)
    assert found.contact_s == math.inf


def test_sine_and_cosine_integral_are_those_of_scipy():
    u = np.geomspace(0.5, 1e6, 2000)
    found = np.array([sine_and_cosine_integral(one) for one in u])
    np.testing.assert_allclose(found, np.transpose(sici(u)), rtol=0.0, atol=3e-15)


@pytest.mark.parametrize("until_s", [1e-9, 1e-4, 2e-4])
def test_a_shorter_look_knows_the_same_errors_as_far_as_it_goes(until_s):
    what = spec()
    given = (what.sphere, what.plate, what.contact, what.contact_point_m)
    whole, short = reflections(*given), reflections(*given, until_s)
    assert len(short.times_s) < len(whole.times_s)
    assert short.contact_s == whole.contact_s
    count = int(np.searchsorted(whole.times_s, max(until_s, whole.contact_s))) + 1
    for actuation in (Actuation(), Actuation(0.8, 1e-4), Actuation(jumps_n=10.0)):
        found, expected = (of.errors(1e-6, actuation)[:count] for of in (short, whole))
        np.testing.assert_allclose(found, expected, rtol=1e-12)
