"""Where methods fail: predicted limits, and the energy-keeping schemes that have none."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import integrator_kernels as ik
from benchmarks import stability_limits as limits
from benchmarks import stability_maps as maps
from benchmarks.integrators import Problem
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from benchmarks.stability_loop import loop_map
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.collocation import CollocationPlant

BALANCED = ("modal", "discrete_gradient")
_RESTING_STEPS = 400


@pytest.mark.parametrize("scheme", limits.LIMITS)
def test_free_vibration_is_stable_just_inside_and_grows_just_outside(scheme: str) -> None:
    limit = limits.LIMITS[scheme]
    assert limits.growth_per_step(scheme, 0.999 * limit) <= 1.0 + 1e-12
    assert limits.growth_per_step(scheme, 1.001 * limit) > 1.0 + 1e-4


@pytest.mark.parametrize("loss_factor", [0.0, 0.01, 0.1, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("scheme", limits.DAMPED)
def test_damped_vibration_is_stable_just_inside_and_grows_just_outside(
    scheme: str, loss_factor: float
) -> None:
    limit = limits.damped_limit(scheme, loss_factor)
    assert limits.growth_per_step(scheme, 0.999 * limit, loss_factor) <= 1.0 + 1e-12
    assert limits.growth_per_step(scheme, 1.001 * limit, loss_factor) > 1.0 + 1e-4


@pytest.mark.parametrize("scheme", limits.DAMPED)
def test_damped_vibration_decays_as_it_should(scheme: str) -> None:
    decay = -math.log(limits.growth_per_step(scheme, 0.01, 0.2)) / 0.01
    assert decay == pytest.approx(0.1, rel=2e-3)  # eta/2; the lagged damping is of first order


def test_implicit_schemes_have_no_damped_limit() -> None:
    with pytest.raises(ValueError, match="newmark is not among the damped schemes"):
        limits.growth_per_step("newmark", 1.0, 0.1)


def test_implicit_methods_do_not_grow() -> None:
    for phase in (0.1, 1.0, 3.0, 100.0):
        assert limits.growth_per_step("newmark", phase) == pytest.approx(1.0, abs=1e-12)
        assert limits.growth_per_step("hht", phase) < 1.0 + 1e-12
    assert limits.growth_per_step("hht", 3.0) < 0.97  # it damps what it cannot follow


def resting_penetration_m(what: Problem) -> float:
    """Penetration under the sphere's own weight, m."""
    weight = what.spec.sphere.mass_kg * ik.GRAVITY
    return float((weight / what.spec.contact.stiffness) ** (2.0 / 3.0))


def resting_motion(scheme: str, what: Problem, phase: float) -> float:
    """Largest motion in 400 steps of a sphere at rest on the plate that is nudged, over what the
    nudge would do on a rigid plate; `phase`: step times highest frequency of the linearised
    contact. Infinite if it blows up."""
    kernel, more = limits.TEXTBOOK[scheme]
    depth = resting_penetration_m(what)
    modes = len(what.omega2)
    y = np.zeros(2 * modes + 2)
    y[:modes] = -what.drive / what.omega2 * what.spec.sphere.mass_kg * ik.GRAVITY
    y[2 * modes] = y[:modes].sum() - depth
    nudge = 1e-6 * depth  # small enough for the contact to stay a spring
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(depth)
    y[2 * modes + 1] = nudge * math.sqrt(spring / what.spec.sphere.mass_kg)
    gaps = np.empty(_RESTING_STEPS)
    step_s = phase / limits.highest_frequency_rad_s(what, depth)
    kernel(y, *what.arguments, step_s, _RESTING_STEPS, 1, gaps, *more)
    moved = float(np.abs(gaps + depth).max()) / nudge
    return moved if math.isfinite(moved) else math.inf


@pytest.mark.parametrize("stiffness", [1.0, 1e2, 1e4])
@pytest.mark.parametrize("scheme", limits.LIMITS)
def test_a_lasting_contact_is_stable_just_inside_and_grows_just_outside(
    scheme: str, stiffness: float
) -> None:
    what = maps.problem_of(maps.stiff(stiffness))
    limit = limits.LIMITS[scheme]
    assert resting_motion(scheme, what, 0.99 * limit) < 10.0
    assert resting_motion(scheme, what, 1.01 * limit) > 1e3


def test_a_stiff_contact_and_not_the_modes_sets_the_limit() -> None:
    what = maps.problem_of(maps.stiff(1e4))
    depth = resting_penetration_m(what)
    highest = limits.highest_frequency_rad_s(what, depth)
    assert highest > 4.0 * math.sqrt(what.omega2.max())
    assert highest == pytest.approx(limits.contact_frequency_rad_s(what, depth), rel=0.01)
    for scheme in ("newmark", "hht"):
        assert resting_motion(scheme, what, 10.0) < 10.0


@pytest.mark.full
def test_only_the_energy_keeping_schemes_keep_the_energy_of_a_contact() -> None:
    for one in maps.contact_drift():
        if one.scheme in BALANCED:
            assert abs(one.change) < 1e-12, one
        elif one.step > 0.05:
            assert abs(one.change) > 1e-5, one


@pytest.mark.full
@pytest.mark.parametrize("name", ["stiffness", "mass", "shaken", "loss"])
def test_energy_residual_at_steps_far_too_large(name: str) -> None:
    found = maps.loss_map() if name == "loss" else getattr(maps, f"{name}_map")()[1]
    mine = [one for one in found if one.scheme in BALANCED]
    assert {one.scheme for one in mine} == set(BALANCED)
    assert max(one.step for one in mine) == pytest.approx(100.0)
    for one in mine:
        # Rounding adds up over bounces, of which the longest steps see hundreds.
        assert abs(one.change) < 1e-12 * (10 + one.contacts), one
        assert one.evaluations < 120, one


@pytest.mark.full
@pytest.mark.parametrize("name", ["stiffness", "mass"])
@pytest.mark.parametrize("scheme", limits.LIMITS)
def test_impacts_blow_up_near_the_predicted_limit(name: str, scheme: str) -> None:
    predicted, found = getattr(maps, f"{name}_map")()
    doubled = maps.border(found, scheme, maps.BLOWN)
    wrong = maps.border(found, scheme, maps.WRONG)
    for one, (where, step), (_, first) in zip(predicted, doubled, wrong, strict=True):
        assert where == one.where
        assert 0.85 < step / getattr(one, scheme) < 1.6, one
        assert first <= step


def shaken_error(make: type[Plant], step_s: float) -> float:
    """Gap over 0.4 ms on a shaken plate against Runge-Kutta at a quarter of the step, over the
    largest gap."""
    spec = replace(maps.few_modes("aluminium-20mm").spec, step_s=step_s)
    speed, steps = 3.0, round(4e-4 / step_s)
    what, plant = maps.problem_of(spec), make(spec)
    energy_j = maps.shake(plant, speed)
    gaps, expected = np.empty(steps), np.empty(4 * steps)
    ik.plant_gaps(plant.model, plant.state, 1, gaps)
    y = what.start()
    at_rest_j = float(ik.energy(y, *what.arguments))
    modes = len(what.omega2)
    y[modes : modes + 10] = speed / 10
    assert energy_j == pytest.approx(float(ik.energy(y, *what.arguments)) - at_rest_j, rel=1e-12)
    ik.rk4(y, *what.arguments, step_s / 4, 4 * steps, 1, expected)
    return float(np.abs(gaps - expected[3::4]).max() / np.abs(gaps).max())


@pytest.mark.full
def test_a_shaken_plate_moves_as_the_textbook_integrator_moves_it() -> None:
    assert shaken_error(CollocationPlant, 2.5e-7) < 1e-7
    coarse, fine = (
        shaken_error(DiscreteGradientPlant, 5e-7),
        shaken_error(DiscreteGradientPlant, 2.5e-7),
    )
    assert fine < 2e-3
    assert coarse / fine == pytest.approx(4.0, rel=0.1)  # of second order


@pytest.mark.full
def test_a_shaken_plate_is_struck_more_than_once() -> None:
    mine = [one for one in maps.shaken_map()[1] if one.scheme == "modal" and one.where >= 1.0]
    assert max(one.contacts for one in mine if one.step < 1.0) >= 3


@pytest.mark.full
def test_the_published_scheme_loses_the_momentum_of_a_contact_at_any_step() -> None:
    found = list(maps.thesis_contact())
    for step, _, _, momentum in found:
        assert momentum > 0.02, step
    assert found[0][3] > 0.5  # and no less as the step shrinks
    assert max(energy for _, _, energy, _ in found) > 1.0


def test_late_actuator_feeds_energy_in() -> None:
    found = {(round(p.kappa, 2), p.latency_us): p for p in loop_map()}
    assert found[0.0, 0.0].injected == 0.0
    assert found[0.0, 0.0].plate_energy_db == pytest.approx(0.0, abs=1e-9)
    assert found[0.4, 0.0].plate_energy_db < -0.1
    assert found[0.4, 30.0].plate_energy_db > 0.5
    assert found[2.0, 30.0].injected > 1.0  # more than the impact brought
    fed = [found[round(kappa, 2), 30.0].injected for kappa in (0.5, 1.0, 1.5, 2.0)]
    assert fed == sorted(fed)


def test_a_quick_map_holds_points_of_the_whole_one() -> None:
    whole, some = list(limits.growth()), list(limits.growth(5))
    assert set(some) < set(whole)
    assert {scheme for scheme, *_ in some} == set(limits.TEXTBOOK)
    predicted, found = maps.stiffness_map(5)
    every_predicted, every_found = maps.stiffness_map()
    assert (len(predicted), len(every_predicted)) == (3, 11)
    assert all(one in every_predicted for one in predicted)
    assert all(one in every_found for one in found)
