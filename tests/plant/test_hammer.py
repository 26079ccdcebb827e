"""Hammers: on a rigid wall against closed forms, on a plate with closed balances, withdrawn."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import (
    Contact,
    Hammer,
    rigid_contact_time_s,
    rigid_impact,
    rigid_peak_force_n,
    tangent_stiffness_n_m,
)
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.scene.build import build_plant
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.cases.evaluate import run_case
from tests.plant.rigs import IMMOVABLE, spec

MASS, SPEED = 0.15, 0.8
STIFFNESS = {1.0: 2e6, 1.25: 2e7, 1.5: 2e8, 2.0: 4e10}  # contacts of about a millisecond
ON_PLATE = ["controller.law=off", "run.duration_s=0.012", "hammer.mass_kg=0.1"]


def hit(exponent: float, stiffness: float, step_s: float) -> tuple[Plant, np.ndarray]:
    """A hammer on an immovable support: the plant and its rows."""
    hammer = Hammer(MATERIALS["steel"], np.nan, SPEED**2 / 19.62, MASS, SPEED)
    contact = Contact(stiffness, exponent=exponent)
    plain = spec(material=IMMOVABLE, contact=contact, step_s=step_s)
    plant = CollocationPlant(replace(plain, sphere=hammer, residual_flexibility=True))
    lasts_s = rigid_impact(hammer, contact).contact_s
    return plant, ts.series_under(plant, np.zeros(round(1.2 * lasts_s / step_s)))


def test_a_linear_tip_moves_as_a_mass_on_a_spring():
    """p = v/w sin(w t) until w t = pi: at order 4, and with 215 steps a contact at rounding."""
    errors = []
    for step_s in (8e-5, 4e-5, 4e-6):
        plant, rows = hit(1.0, STIFFNESS[1.0], step_s)
        omega = np.sqrt(STIFFNESS[1.0] / MASS)
        since_s = (np.arange(rows.shape[1]) - 0.5) * step_s  # the lead-in is half a step
        touching = (since_s > 0.0) & (since_s < np.pi / omega)
        expected = SPEED / omega * np.sin(omega * since_s)
        errors.append(np.abs(rows[ts.XI] + expected)[touching].max() * omega / SPEED)
        assert plant.sphere_speed_m_s() == pytest.approx(SPEED, rel=1e-12)
    print("error of the penetration over its largest:", *errors)
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert errors[2] < 1e-10


@pytest.mark.full
@pytest.mark.parametrize("exponent", STIFFNESS)
def test_every_exponent_has_its_closed_form_on_a_rigid_wall(exponent):
    stiffness = STIFFNESS[exponent]
    plant, rows = hit(exponent, stiffness, 2e-6)
    rigid = rigid_impact(plant.spec.sphere, plant.spec.contact)
    (found,) = impacts_in(plant.spec, rows)
    # The contact time is found by linear interpolation of the gap within a step.
    assert found.duration_s == pytest.approx(rigid.contact_s, rel=1e-6)
    assert found.peak_force_n == pytest.approx(rigid.peak_n, rel=1e-8)
    assert found.impact_speed_m_s == pytest.approx(SPEED, rel=1e-9)
    assert found.rebound_speed_m_s == pytest.approx(SPEED, rel=1e-9)
    balance = plant.close_balance()
    assert abs(balance.energy_residual) < 1e-12
    assert abs(balance.momentum_residual) < 1e-12
    assert balance.gravity_j == 0.0


def test_closed_forms_of_a_power_of_the_penetration():
    for n in (1.0, 1.25, 1.5, 1.9999):
        part = n + 1.0  # with x = 1 - t^2 the integral of dx/sqrt(1 - x^(n+1)) is smooth
        whole = quad(lambda t, part=part: 2.0 * t / np.sqrt(1.0 - (1.0 - t * t) ** part), 0.0, 1.0)
        deepest = (0.5 * part * 0.3 * 0.49 / 2e7) ** (1.0 / part)
        given = rigid_contact_time_s(0.3, 2e7, 0.7, n)
        assert given == pytest.approx(2.0 * deepest / 0.7 * whole[0], rel=1e-9)
        # dF/dp = n F/p
        force = 2e7 * 1e-5**n
        assert tangent_stiffness_n_m(2e7, force, n) == pytest.approx(n * force / 1e-5, rel=1e-12)
    assert rigid_contact_time_s(0.3, 2e7, 0.7, 1.0) == pytest.approx(np.pi * np.sqrt(0.3 / 2e7))
    # Energy: m v^2/2 = 2/5 s p^(5/2) at the peak.
    peak = rigid_peak_force_n(0.3, 2e9, 0.7)
    assert 0.4 * 2e9 * (peak / 2e9) ** (5 / 3) == pytest.approx(0.5 * 0.3 * 0.49, rel=1e-14)


def on_plate(*settings: str) -> tuple[Setup, Plant, np.ndarray]:
    """The default plate under a hammer: its setup, plant and rows."""
    setup = load("aluminium-3mm", [*ON_PLATE, "hammer.speed_m_s=0.5", *settings])
    plant = build_plant(setup)
    return setup, plant, ts.series_under(plant, np.zeros(setup.steps))


@pytest.mark.full
def test_a_hammer_is_withdrawn_after_the_first_contact():
    settings = ["hammer.tip_stiffness=5e9", "hammer.tip_exponent=1.5"]
    (_, _, once), (_, _, often) = (
        on_plate(*settings, f"hammer.bounces={bounces}") for bounces in ("false", "true")
    )
    touched = once[ts.F_C] != 0.0
    begun, end = np.flatnonzero(touched)[[0, -1]] + [0, 1]
    assert touched[begun:end].all()
    assert np.flatnonzero(often[ts.F_C] != 0.0)[-1] > end + 100  # it would have hit again
    assert np.array_equal(once[:, :end], often[:, :end])
    gap = once[ts.XI, end:]
    assert (gap > 0.0).all()
    away = 0.5 * 1e-6 * (np.arange(len(gap)) - 3.0)  # at least as fast as it came
    assert (gap >= away).all()


@pytest.mark.full
def test_an_infinite_plate_lets_a_hammer_go_too():
    tip = ["hammer.tip_stiffness=1e6", "hammer.tip_exponent=1"]
    hit = ["plate.size_m=[3, 3]", "plate.contact_point_m=[1.5, 1.5]", "run.duration_s=0.0035"]
    rows = [
        on_plate(*tip, *hit, f"run.plate_model={model}")[2][:, :3000]
        for model in ("infinite", "modal")
    ]
    infinite, modal = (row[ts.F_C] for row in rows)
    assert np.abs(infinite - modal).max() < 0.01 * modal.max()
    assert (rows[0][ts.XI, np.flatnonzero(infinite)[-1] + 1 :] > 0.0).all()


@pytest.mark.full
def test_a_sweep_gives_the_energy_that_a_hammer_keeps():
    setup = load(
        "aluminium-20mm",
        ["hammer.mass_kg=0.005", "hammer.speed_m_s=0.3", "hammer.tip_radius_m=0.005"],
    )
    controlled, free = (
        run_case(setup.vary({"controller.law": law}), "impact", 0, {})
        for law in ("slope_threshold", "off")
    )
    assert free["rebound_percent"] == pytest.approx(100.0)
    speeds = controlled["rebound_m_s"] / free["rebound_m_s"]
    assert controlled["rebound_percent"] == pytest.approx(100.0 * speeds**2)
