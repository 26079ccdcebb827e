"""The study of the ideal and the real plant, on a coarse case."""

import pytest

from benchmarks import real_plant as study
from benchmarks.latency import Named

# These need a kind of plant of their own, whose kernels take half a minute to compile.
pytestmark = pytest.mark.full

COARSE = Named(
    "coarse",
    "aluminium-3mm",
    ("run.accuracy=0.1", "run.duration_s=0.0013", "controller.v_thr_m_s=-0.6"),
    "impact",
)


def test_a_contact_with_a_damper_keeps_its_loss():
    """It would lose twice with yield."""
    oak = next(named for named in study.SCENES if named.name == "oak-20mm")
    scene = study.plant_of(oak, "real")
    assert scene.scene.contact.damping == "hunt_crossley"
    assert scene.scene.contact.plasticity == "none"
    assert scene.mechanics.actuator.bandwidth_hz == 300e3


def test_noise_goes_with_the_range_that_law_and_latency_ask_for():
    scene = study.plant_of(COARSE, "real")
    noises = [
        study.with_noise(scene, values)["sensors.noise_rms"]
        for values in ({"controller.latency_us": 0}, {"controller.latency_us": 40})
    ]
    assert noises[0] < noises[1] < 1e-7
    assert "sensors.noise_rms" not in study.with_noise(study.plant_of(COARSE, "ideal"), {})
