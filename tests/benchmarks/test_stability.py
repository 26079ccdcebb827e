"""Where methods fail: predicted limits, and the energy-keeping schemes that have none."""

import pytest

from benchmarks import stability_limits as limits
from benchmarks import stability_maps as maps
from benchmarks.stability_loop import loop_map

BALANCED = ("modal", "discrete_gradient")


@pytest.mark.parametrize("scheme", limits.LIMITS)
def test_free_vibration_is_stable_just_inside_and_grows_just_outside(scheme):
    limit = limits.LIMITS[scheme]
    assert limits.growth_per_step(scheme, 0.999 * limit) <= 1.0 + 1e-12
    assert limits.growth_per_step(scheme, 1.001 * limit) > 1.0 + 1e-4


@pytest.mark.full
def test_only_the_energy_keeping_schemes_keep_the_energy_of_a_contact():
    for one in maps.contact_drift():
        if one.scheme in BALANCED:
            assert abs(one.change) < 1e-12, one
        elif one.step > 0.05:
            assert abs(one.change) > 1e-5, one


@pytest.mark.full
@pytest.mark.parametrize("name", ["stiffness", "mass", "shaken", "loss"])
def test_energy_residual_at_steps_far_too_large(name):
    mine = getattr(maps, f"{name}_map")()
    assert {one.scheme for one in mine} == set(BALANCED)
    assert max(one.step for one in mine) == pytest.approx(100.0)
    for one in mine:
        # Rounding adds up over bounces, of which the longest steps see hundreds.
        assert abs(one.change) < 1e-12 * (10 + one.contacts), one
        assert one.evaluations < 120, one


@pytest.mark.full
def test_a_shaken_plate_is_struck_more_than_once():
    mine = [one for one in maps.shaken_map() if one.scheme == "modal" and one.where >= 1.0]
    assert max(one.contacts for one in mine if one.step < 1.0) >= 3


@pytest.mark.full
def test_the_published_scheme_loses_the_momentum_of_a_contact_at_any_step():
    found = list(maps.thesis_contact())
    for step, _, _, momentum in found:
        assert momentum > 0.02, step
    assert found[0][3] > 0.5  # and no less as the step shrinks
    assert max(energy for _, _, energy, _ in found) > 1.0


def test_late_actuator_feeds_energy_in():
    found = {(round(p.kappa, 2), p.latency_us): p for p in loop_map()}
    assert found[0.0, 0.0].injected == 0.0
    assert found[0.0, 0.0].plate_energy_db == pytest.approx(0.0, abs=1e-9)
    assert found[0.4, 0.0].plate_energy_db < -0.1
    assert found[0.4, 30.0].plate_energy_db > 0.5
    assert found[2.0, 30.0].injected > 1.0  # more than the impact brought
    fed = [found[round(kappa, 2), 30.0].injected for kappa in (0.5, 1.0, 1.5, 2.0)]
    assert fed == sorted(fed)
