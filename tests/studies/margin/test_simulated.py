"""Growth that the linear loop predicts, against the compiled closed loop in flight."""

import math

import pytest

from benchmarks.margin import simulated_growth_per_s
from hertzloop.scene.setup import load
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.growth import growth_of

SCENE = [
    "controller.law=velocity_feedback",
    "sensors.quantity=v_p",
    "controller.kappa=0.4",
    "run.lead_in_s=0.09",
    "run.duration_s=0.1",
]


@pytest.mark.parametrize(
    "settings",
    [
        ["actuator.dead_time_us=3", "controller.latency_us=2"],
        ["sensors.ac_coupling_hz=500", "sensors.every_steps=3"],
        ["sensors.resonance_hz=60000"],
        ["sensors.low_pass_hz=200000", "actuator.dead_time_us=4"],
        pytest.param(
            ["controller.law=acceleration_feedback", "sensors.quantity=acceleration"],
            marks=pytest.mark.full,
        ),
    ],
)
def test_growth_is_that_of_the_closed_loop(settings):
    setup = load("aluminium-20mm", [*SCENE, *settings])
    found = growth_of(setup)
    assert found.per_s > 0.0
    assert simulated_growth_per_s(setup, found.per_s) == pytest.approx(found.per_s, rel=0.01)


def test_dead_time_counts_as_latency():
    oak = load("oak-20mm", SCENE)
    late = load("oak-20mm", [*SCENE, "actuator.dead_time_us=40"])
    one, other = margin_of(oak), margin_of(late)
    assert other.latency_limit_steps == one.latency_limit_steps - 40
    assert other.latency_limit_us == pytest.approx(one.latency_limit_us - 40.0)
    assert other.binding_frequency_hz == one.binding_frequency_hz
    [[first, last]] = other.stable_windows_us
    assert first == 0.0
    assert last == pytest.approx(one.stable_windows_us[0][1] - 40.0)
    same = growth_of(load("oak-20mm", [*SCENE, "controller.latency_us=520"]))
    dead = growth_of(late.vary({"controller.latency_us": 480.0}))
    assert same == dead
    assert same.unstable_poles > 0
    assert math.isfinite(same.per_s)


def test_a_loop_that_samples_every_third_step_names_what_binds_it():
    found = margin_of(load("oak-20mm", [*SCENE, "sensors.every_steps=3"]))
    assert found.latency_limit_steps == pytest.approx(497, abs=2)
    assert found.binding_frequency_hz == pytest.approx(790.9, rel=1e-3)
