"""The latency study: maps, critical values read off, pictures."""

import math

from benchmarks import latency as study
from hertzloop.scene.setup import load


def named(*settings: str) -> study.Named:
    cheap = ("run.accuracy=0.1", "run.duration_s=0.0013")
    return study.Named("cheap", "aluminium-3mm", (*cheap, *settings), "impact")


def test_the_critical_latency_is_where_the_plate_energy_crosses(pool):
    early = named("controller.v_thr_m_s=-0.6")
    found = study.critical(pool, early, "slope_threshold", 5)
    scene = early.scene()
    at, after = (
        study.evaluate(pool, scene, "impact", [{"controller.latency_us": int(latency)}])[0]
        for latency in (found.critical_latency_us, found.critical_latency_us + 1)
    )
    assert at["plate_energy_db"] < 0.0 <= after["plate_energy_db"]


def test_an_unstable_law_survives_nothing(pool):
    unstable = named("controller.kappa=3.0")
    found = study.critical(pool, unstable, "slope_threshold", 2)
    assert found.ideal_db > 0.0
    assert math.isnan(found.critical_latency_us)


def test_a_law_without_kappa_has_maps_of_what_it_has():
    scene = load("aluminium-3mm", ["controller.law=off"])
    assert list(study.map_axes(scene, 4)) == ["sensors.bits", "sensors.every_steps"]
