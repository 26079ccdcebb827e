"""Later impacts: how far what was before is magnified, and how far runs can be compared."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.recordings.compare import first_difference
from hertzloop.results.metrics import metrics_of
from hertzloop.results.predictability import horizon_step, known_impacts, whole_run_known
from hertzloop.scene.setup import load as load_setup
from tests.commands import invoke, succeed
from tests.hertzloop.scenes import aluminium_3mm, recorded

FOUR = aluminium_3mm("run.duration_s=0.35")


def test_every_bounce_of_a_light_ball_magnifies_what_was_before():
    impacts = metrics_of(FOUR, simulate(FOUR).truth).by_impact
    known = known_impacts(FOUR, impacts, 1e-3)
    grown = [each.amplification for each in known]
    assert grown[0] == pytest.approx(2.0, abs=0.3)  # what its energy does to that of the plate
    assert grown[1] > 50.0 * grown[0]
    assert grown[2] > 50.0 * grown[1]
    # At the accuracy of the scene nothing is left of the third's rebound.
    assert known[1].errors["rebound_speed_m_s"] < impacts[1]["rebound_speed_m_s"]
    assert known[2].errors["rebound_speed_m_s"] > impacts[2]["rebound_speed_m_s"]


def test_late_forces_are_no_chaos():
    """A paced run differs from its lock-step by far more than by what its bounces magnify."""
    scene = aluminium_3mm("run.duration_s=0.15")
    impacts = metrics_of(scene, simulate(scene).truth).by_impact
    paced = [{name: 1.01 * value for name, value in impact.items()} for impact in impacts]
    in_lock_step = known_impacts(scene, impacts, 1e-3)
    assert known_impacts(scene, paced, 1e-3, in_lock_step=False) == in_lock_step
    more = known_impacts(scene, [*paced, paced[-1]], 1e-3, in_lock_step=False)
    assert more[-1].amplification == np.inf


def test_the_error_of_the_second_impact_is_what_more_modes_change():
    scene = aluminium_3mm("run.duration_s=0.15")
    finer = aluminium_3mm("run.duration_s=0.15", "run.accuracy=1e-4")
    one, other = (metrics_of(s, simulate(s).truth).by_impact for s in (scene, finer))
    known = known_impacts(scene, one, 1e-3)
    for key in vars(Impact(*range(7))):
        assert abs(one[1][key] - other[1][key]) < 2.0 * known[1].errors[key], key


def test_the_whole_run_is_known_where_a_run_says_so(here):
    """As the verdict of `run` on later impacts; a sweep and a budget print it as well."""
    assert whole_run_known(load_setup("aluminium-20mm"))
    assert not whole_run_known(FOUR)
    words = ["sweep", "aluminium-3mm", "--over", "controller.latency_us=0,4", "--workers", "1"]
    printed = " ".join(succeed(*words).split())
    assert "At the least plate energy: Later impacts are not predictable." in printed
    assert "over all contacts" not in printed


def test_compare_stops_where_rounding_decides(tmp_path):
    """A run that differs by the rounding of another processor, magnified 1e5 times."""
    keys = ["run.duration_s=0.1", "run.accuracy=0.02", "controller.law=off"]
    heights = ("0.005", "0.005000000000000005")
    scene, nudged = (aluminium_3mm(*keys, f"sphere.drop_height_m={h}") for h in heights)
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    one, other = recorded(scene, a), recorded(nudged, b)
    horizon = horizon_step(scene, 1e-9)
    assert 0.03 < horizon * 1e-6 < 0.1
    assert first_difference(one, other, 1e-9)
    assert first_difference(one, other, 1e-9, horizon) is None
    assert "Compared up to" in succeed("compare", "--tolerance", "1e-9", str(a), str(b))
    exact = invoke(["compare", str(a), str(b)])
    assert exact.exit_code == 1
