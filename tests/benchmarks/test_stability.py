"""Where methods fail: predicted limits, and the energy-keeping schemes that have none."""

import pytest

from benchmarks import stability_limits as limits
from benchmarks import stability_maps as maps

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
