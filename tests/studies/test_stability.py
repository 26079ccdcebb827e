"""Where methods fail: predicted limits, and the default scheme that has none."""

import pytest

from studies import stability as study


@pytest.mark.parametrize("scheme", study.LIMITS)
def test_free_vibration_is_stable_just_inside_and_grows_just_outside(scheme: str) -> None:
    limit = study.LIMITS[scheme]
    assert study.growth_per_step(scheme, 0.999 * limit) <= 1.0 + 1e-12
    assert study.growth_per_step(scheme, 1.001 * limit) > 1.0 + 1e-4


def test_implicit_methods_do_not_grow() -> None:
    for phase in (0.1, 1.0, 3.0, 100.0):
        assert study.growth_per_step("newmark", phase) == pytest.approx(1.0, abs=1e-12)
        assert study.growth_per_step("hht", phase) < 1.0 + 1e-12
    assert study.growth_per_step("hht", 3.0) < 0.97  # it damps what it cannot follow


def test_only_the_energy_keeping_schemes_keep_the_energy_of_a_contact() -> None:
    found = list(study.contact_drift())
    for scheme, share, drift in found:
        if scheme in ("modal", "discrete_gradient"):
            assert drift < 1e-10, (scheme, share)
        elif share > 0.05:
            assert drift > 1e-5, (scheme, share)


def test_energy_residual_at_steps_far_too_large() -> None:
    for ratio, share, residual, evaluations in study.residual_map():
        assert residual < 1e-10, (ratio, share)
        assert evaluations < 120


def test_late_actuator_feeds_energy_in() -> None:
    found = {(round(p.kappa, 2), p.latency_us): p for p in study.loop_map()}
    assert found[0.0, 0.0].injected == 0.0
    assert found[0.0, 0.0].plate_energy_db == pytest.approx(0.0, abs=1e-9)
    assert found[0.4, 0.0].plate_energy_db < -0.1
    assert found[0.4, 30.0].plate_energy_db > 0.5
    assert found[2.0, 30.0].injected > 1.0  # more than the impact brought
    fed = [found[round(kappa, 2), 30.0].injected for kappa in (0.5, 1.0, 1.5, 2.0)]
    assert fed == sorted(fed)
