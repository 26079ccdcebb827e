"""Closed forms of what a scene leaves out, against values worked out by hand."""

import math

import pytest

from benchmarks.zener import solved
from hertzloop.plant.contact.hertz import Sphere
from hertzloop.plant.estimates import criteria
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate

STEEL, ALUMINIUM = MATERIALS["steel"], MATERIALS["aluminium"]
PLATE = Plate(ALUMINIUM, (0.5, 0.5), 0.003)


def sphere(radius_m: float) -> Sphere:
    return Sphere(STEEL, radius_m, 0.05)


def test_waves_come_back_from_the_nearest_edge():
    # a = sqrt(B'/m'') = 4.76 m2/s; 2 x 0.1 m at 2 sqrt(a 2 pi/28.9 us) = 2035 m/s: 98 us.
    back = criteria.first_return_s(PLATE, (0.5, 0.5), (0.1, 0.25), 28.9e-6)
    assert back == pytest.approx(98.3e-6, rel=0.01)
    assert criteria.first_return_s(PLATE, (0.5, 0.5), (0.4, 0.25), 28.9e-6) == pytest.approx(back)


def test_an_infinite_plate_errs_more_with_time_and_with_control():
    errors = [
        criteria.reflections_error(late, 0.3, share, late)
        for late in (0.2, 0.4)
        for share in (0, 0.5)
    ]
    assert errors == sorted(errors)
    assert criteria.switched_error(0.2, 0.3, 0.1, 2.0) > criteria.switched_error(0.2, 0.3, 0.1, 1.0)
    # Zener's equation on a plate that is as heavy as the sphere takes a third longer.
    for number in (0.1, 1.0, 2.9):
        length, _, _ = solved(number)
        rigid, _, _ = solved(0.0)
        assert 1.0 < criteria.zener_contact_s(number, rigid) / length < 1.25


def test_air():
    # rho0 c/(omega m'') is 1.6e-3 at 5 kHz, 1.3 times the critical frequency of 3869 Hz.
    assert criteria.air_loss_factor(PLATE) == pytest.approx(1.6e-3, rel=0.01)
    assert criteria.squeezed_film(sphere(0.003)) == pytest.approx(7e-5, rel=0.05)
    assert criteria.squeezed_film(sphere(0.02)) == pytest.approx(1.3e-5, rel=0.05)
    assert criteria.drag_on_the_drop(sphere(0.003)) == pytest.approx(4.5e-4, rel=0.02)
    assert criteria.drag_on_the_drop(sphere(0.02)) == pytest.approx(6.8e-5, rel=0.02)


def test_a_mass_counts_from_a_twentieth_on():
    # The 3 mm ball has 0.882 g; the impedance at 1/T, 309 N s/m x 28.9 us/(2 pi), is 1.4 g.
    ball = sphere(0.003)
    mass = criteria.mass_that_matters_kg(ball, PLATE, 28.9e-6)
    assert mass == pytest.approx(0.05 * 0.882e-3, rel=2e-3)
    short = criteria.mass_that_matters_kg(ball, PLATE, 2.89e-6)
    impedance = PLATE.infinite_plate_impedance_n_s_m
    assert short == pytest.approx(0.05 * impedance * 2.89e-6 / (2.0 * math.pi))
