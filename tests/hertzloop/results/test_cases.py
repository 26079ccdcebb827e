"""Metrics of a case: over the length of time that they are said to be over."""

import math

import numpy as np
import pytest

from hertzloop.loop.simulate import SimulatedRun, simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.results import spans
from hertzloop.results.cases import digest_of, metrics_of_case
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from tests.commands import as_options, succeed
from tests.hertzloop.scenes import aluminium_3mm, json_in

SHORT = ["run.accuracy=0.05", "run.duration_s=0.0018", "run.plate_model=modal"]


@pytest.mark.parametrize(
    ("keys", "percent"),
    [
        ([], 156.0),
        (["controller.latency_us=2"], 140.0),
        (["controller.v_thr_m_s=-0.6"], 192.0),
        (["controller.lead_us=3"], 180.0),
    ],
)
def test_the_rebound_is_a_height_in_per_cent_of_that_without_control(keys, percent):
    scene = aluminium_3mm(*keys, "run.duration_s=0.002")
    found = metrics_of_case(scene).rebound_percent
    assert found == pytest.approx(percent, abs=0.5)
    speeds = [
        impacts_in(s.plant, simulate(s).truth)[0].rebound_speed_m_s
        for s in (scene, scene.without_control())
    ]
    assert found == pytest.approx(100.0 * (speeds[0] / speeds[1]) ** 2, rel=1e-3)


def test_no_rebound_without_control_is_nothing_to_compare_with():
    """The first impact leaves the heavy sphere falling still."""
    metrics = metrics_of_case(load("aluminium-20mm", ["run.duration_s=0.003"]))
    assert math.isnan(metrics.rebound_percent)


def test_of_a_rebound_within_the_models_error_nothing_is_a_share(tmp_path):
    settings = ["plate.thickness_m=0.0011", "run.accuracy=0.05", "run.duration_s=0.004"]
    assert math.isnan(metrics_of_case(aluminium_3mm(*settings)).rebound_percent)
    out = ["--transport", "compiled", "--out", tmp_path / "a.mcap", "--json", tmp_path / "a.json"]
    told = succeed("run", "aluminium-3mm", *as_options(settings), *out)
    report = json_in(tmp_path / "a.json")
    noise = [some["noise"][0] for some in (report, report["uncontrolled"])]
    assert noise[0]["rebound_height_m"] > 1e3 * noise[1]["rebound_height_m"] > 0.0
    assert "rebound height about 10 mm instead of nearly 0" in " ".join(told.split())


def test_numbers_that_are_not_finite_make_no_metrics(monkeypatch):
    scene = aluminium_3mm(*SHORT)

    def broken(scene: Setup, *, impact_only: bool, steps: int | None = None) -> SimulatedRun:
        found = simulate(scene, impact_only, steps=steps)
        found.truth[3, -1] = math.nan
        return found

    monkeypatch.setattr(spans, "simulate", broken)
    with pytest.raises(SceneError, match="not finite"):
        metrics_of_case(scene)


def test_a_delay_of_zero_is_a_delay():
    """A threshold below the impact speed is crossed by the first sample in contact."""
    keys = ["run.accuracy=0.1", "run.duration_s=0.0013"]
    at_once = metrics_of_case(aluminium_3mm(*keys, "controller.v_thr_m_s=-2"))
    assert at_once.delay_us == 0.0
    off = metrics_of_case(aluminium_3mm(*keys, "controller.law=off"))
    assert off.delay_us != off.delay_us  # nan


def test_the_digest_tells_every_bit_apart():
    generator = np.random.default_rng(1)
    truth, codes = generator.random((10, 31)), generator.integers(-9, 9, 31)
    other = truth.copy()
    other[3, 29] = np.nextafter(other[3, 29], 2.0)
    changed = [
        (other, codes),
        (truth, codes + 1),
        (truth[:, :30], codes),
        (truth[::-1].copy(), codes),
    ]
    digests = {digest_of(*each) for each in [(truth, codes), *changed]}
    assert len(digests) == 5
    assert digest_of(np.hstack([truth, truth])[:, :31], codes.copy()) in digests
