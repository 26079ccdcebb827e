"""Measured latencies, faults of sensor and actuator: from scene keys to the closed loop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import Keys, LawContext
from hertzloop.controller.loading.registry import find
from hertzloop.loop.run_options import RunOptions
from hertzloop.loop.simulate import simulate
from hertzloop.recordings.latencies import latencies_of
from hertzloop.recordings.reader import read as read_recording
from hertzloop.recordings.recording import Recording
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.effect_rows import RunContext
from hertzloop.results.recorded import truth_of
from hertzloop.results.statistics import Extremes
from hertzloop.scene.setup import parse
from hertzloop.scene.toml import to_toml
from hertzloop.sensors import kernels as k
from hertzloop.sensors.acquisition import Fault, Sensor, SensorSpec
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0013", "controller.law=force_feedback"]


def digest(*settings):
    """Fingerprint of all samples of a case."""
    return metrics_of_case(aluminium_3mm(*SHORT, *settings)).digest


@pytest.fixture
def trace(tmp_path):
    """Write a trace; returns the setting that names it."""

    def write(text):
        path = tmp_path / "trace.csv"
        path.write_text(text)
        return f"controller.latency_trace={path}"

    return write


@pytest.mark.parametrize("law", ["force_feedback", "slope_threshold"])
def test_a_constant_trace_gives_the_bytes_of_the_latency(trace, law):
    law = f"controller.law={law}"
    bits = "sensors.bits=12"  # the range of the converter depends on the latency
    constant = digest("controller.latency_us=4", law, bits)
    assert digest(trace("latency_us\n4.2\n4\n3.9\n"), law, bits) == constant
    assert digest(law, bits) != constant


def test_a_trace_is_repeated_or_resampled_by_the_seed(trace):
    given = trace("0\n1\n2\n3\n4\n5\n6\n7\n")
    replayed = digest(given)
    assert digest(given, "run.seed=2") == replayed
    resampled = "controller.latency_trace_use=resample"
    assert digest(given, resampled) == digest(given, resampled)
    assert digest(given, resampled) != digest(given, resampled, "run.seed=2")
    bound = find("off").bind(Keys(), LawContext())
    path = SignalPath(trace=tuple(range(1000)), resampled=True)
    kept = Controller(bound, path, 1e-6, 2000, 1, 1).path.added_steps
    assert 0.95 < np.mean(np.diff(kept) == 1) < 1.0  # blocks keep the autocorrelation


def test_a_scene_with_a_trace_survives_its_file(trace, tmp_path):
    setup = aluminium_3mm(*SHORT, trace("2\n6\n"))
    (tmp_path / "trace.csv").unlink()
    again = parse(to_toml(setup.scene))
    assert metrics_of_case(again).digest == metrics_of_case(setup).digest
    assert again.latency_us == 2.0
    assert again.signal_path.most_added_steps == 4
    other = setup.vary({"controller.latency_trace": [3.0]})
    assert metrics_of_case(other).digest == digest("controller.latency_us=3")


def test_a_recording_of_a_paced_run_tells_its_latencies():
    """Samples every 2 steps with a latency of 1: their forces are due at 2, 4, 6, 8, 10.
    The run ends after step 9, before the fourth one has acted: with a latency of 3 it does not."""
    held = np.array([0, 0, 0, 1, 2, 3, 4, 0, 1, 2])  # the force of step 2 acts until step 7
    scene = "[run]\nstep_ns = 1000\n[sensors]\nevery_steps = 2\n[controller]\nlatency_us = 1.0\n"
    recording = Recording(Path("a.mcap"), scene_toml=scene)
    recording.truth = replace(recording.truth, arrays={"held_steps": held})
    assert list(latencies_of(recording)) == [1.0, 4.0, 2.0, 3.0, 1.0]
    recording.truth = replace(recording.truth, arrays={})
    with pytest.raises(ValueError, match="--pace"):
        latencies_of(recording)


@pytest.mark.full
def test_the_trace_of_a_paced_run_repeats_it(tmp_path):
    path, short = tmp_path / "paced.mcap", ["run.duration_s=0.0012", SHORT[1]]
    setup = aluminium_3mm(*short)
    run_and_assess(setup, path, RunOptions(pace=0.01))
    again = aluminium_3mm(*short, f"controller.latency_trace={path}")
    rows = simulate(again.with_plate_model(setup.plate_model)).truth
    assert np.array_equal(rows, truth_of(read_recording(path)))


def read(fault, values, seed=1):
    """What a channel with a fault reads."""
    sensor = Sensor(SensorSpec(fault=fault), 1e-6, len(values), seed)
    found = []
    for index, value in enumerate(values):
        k.follow(sensor.model, sensor.state, value)
        found.append(k.sample(sensor.model, sensor.state, index)[1])
    return found


def test_faults_of_a_sensor_do_what_they_say():
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert read(None, values) == values
    assert read(Fault("stuck", 2, 3), values) == [1.0, 2.0, 2.0, 2.0, 2.0, 6.0]
    assert read(Fault("offset", 4, size=0.5), values) == [1.0, 2.0, 3.0, 4.0, 5.5, 6.5]
    assert read(Fault("saturation", size=-3.5), values) == [1.0, 2.0, 3.0, 3.5, 3.5, 3.5]
    assert read(Fault("spikes", size=9.0, probability=1.0), values)[0] == 10.0
    many = [float(i) for i in range(5000)]
    spikes = np.flatnonzero(np.array(read(Fault("spikes", 100, size=9.0), many)) - many)
    assert 20 < len(spikes) < 90
    assert spikes[0] >= 100
    bursts = np.array(read(Fault("drop_outs", lasts=5, probability=0.01), many)) - many
    assert bursts.min() <= -5.0
    assert read(Fault("drop_outs", probability=0.01), many, 2) != read(
        Fault("drop_outs", probability=0.01), many
    )


@pytest.mark.parametrize(
    "fault",
    [
        Fault("stuck"),
        Fault("stuck", 0, 3),
        Fault("drop_outs", probability=1.0),
        Fault("drop_outs", lasts=4, probability=0.9),
    ],
)
def test_the_first_sample_has_no_reading_before_it_that_a_fault_could_repeat(fault):
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert read(fault, values)[:3] == [1.0, 1.0, 1.0]


def test_an_actuator_may_be_late_or_stuck():
    def line(**given):
        bound = find("off").bind(Keys(), LawContext())
        return Controller(bound, SignalPath(**given), 1e-6, 20, 1, 1).path

    assert line().added_steps.size == line().dropped.size == 0
    assert list(line(dead_steps=3).added_steps[:2]) == [3, 3]
    assert list(np.flatnonzero(line(latency_steps=2, stuck_step=10).dropped)) == list(range(7, 20))


@pytest.mark.parametrize(
    "settings",
    [
        ("sensors.fault=stuck", "sensors.fault_start_s=0.00101"),
        ("sensors.fault=offset", "sensors.fault_size=5"),
        ("sensors.fault=spikes", "sensors.fault_size=20"),
        ("sensors.fault=drop_outs", "sensors.fault_probability=0.3"),
        ("sensors.fault=saturation", "sensors.fault_size=30"),
        ("actuator.dead_time_us=3",),
        ("actuator.stuck_from_s=0.00102",),
    ],
    ids=lambda given: given[0],
)
def test_every_fault_reaches_the_closed_loop(settings):
    assert digest(*settings) == digest(*settings)
    assert digest(*settings) != digest()


def test_the_delay_of_the_loop_counts_a_dead_time():
    run = Extremes(force_n=90.0, contact_s=3e-5, deflection_m=1e-6, actuator_n=1.0, touched_s=1e-4)
    delays = [
        RunContext(aluminium_3mm(setting), run).delay_s
        for setting in ("controller.latency_us=3", "actuator.dead_time_us=3", "run.seed=1")
    ]
    assert delays[0] == pytest.approx(delays[1], rel=1e-12)
    assert delays[0] - delays[2] == pytest.approx(3e-6, rel=1e-9)
