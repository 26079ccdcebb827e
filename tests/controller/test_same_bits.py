"""Laws, signal path and data acquisition give the same bytes on every processor."""

import json

import pytest

from tests.processors import FEW, said

# The published scheme: what laws ask of the plant is the same on every processor.
PROGRAM = """
import hashlib, json, sys
import hertzloop
import numpy as np
from hertzloop.loop.answering import answer_samples
from hertzloop.common.jit import kernel
from hertzloop.scene.build import build_sensor
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import load
from hertzloop.sensors import kernels as sensor_kernels

t = np.arange(5000)
gap = 1e-5 * (((t % 700) - 80.0) ** 2 / 6400.0 - 1.0) + 1e-8 * np.random.default_rng(3).random(5000)

@kernel
def read_all(model, state, values, found):
    for i in range(values.size):
        sensor_kernels.follow(model, state, values[i])
        found[0, i], found[1, i], _ = sensor_kernels.sample(model, state, i)

digests = []
for settings in json.loads(sys.argv[1]):
    setup = load("thesis-aluminium", ["run.duration_s=0.005", *settings])
    sensor, read = build_sensor(setup), np.empty((2, 5000))
    read_all(sensor.model, sensor.state, gap, read)
    controller = build_controller(setup)
    reply = answer_samples(controller, read[1])
    parts = (read, controller.forces, reply.modes, reply.delays)
    found = b"".join(part.tobytes() for part in parts)
    digests.append(hashlib.sha256(found).hexdigest()[:16])
print(json.dumps(digests))
"""
LAWS = {
    "acceleration_feedback": ["sensors.quantity=acceleration"],
    "constant": ["controller.force_n=3", "controller.duration_us=40"],
    "fade_out": [],
    "force_feedback": ["sensors.quantity=contact_force"],
    "least_squares": [],
    "linear": ["controller.numerator=[1e5, 2e4]", "controller.denominator=[1, -0.3, 0.1]"],
    "predicted": ["controller.latency_us=4"],
    "profile": ["controller.profile_n=[1.0, 0.1]"],
    "shifted_threshold": ["controller.latency_us=4"],
    "slope_threshold": [],
    "velocity_feedback": ["sensors.quantity=v_p"],
}
FORCES = ["F_a1", "F_a2", "F_a6", "F_a10", "F_mobility"]
LINE = ["controller.latency_us=3", "controller.jitter_us=4", "controller.drop_out_probability=0.01"]
LINE += ["controller.bits=10", "controller.full_scale_n=50", "controller.slew_n_s=1e6"]
SENSORS = [
    ["sensors.bits=12", "sensors.full_scale=[-1e-4, 1e-3]", "sensors.noise_rms=1e-7"],
    ["sensors.resonance_hz=40000", "sensors.ac_coupling_hz=10"],
    *(
        ["sensors.low_pass_hz=51234.5", f"sensors.low_pass={kind}", f"sensors.low_pass_order={n}"]
        for kind in ("butterworth", "bessel")
        for n in (1, 3, 8)
    ),
    *(
        [f"sensors.fault={fault}", "sensors.fault_start_s=0.0005", *size]
        for fault, size in (
            ("stuck", []),
            ("offset", ["sensors.fault_size=1e-6"]),
            ("spikes", ["sensors.fault_size=1e-6"]),
            ("drop_outs", []),
            ("saturation", ["sensors.fault_size=1e-6"]),
        )
    ),
]
CASES = [
    *([f"controller.law={law}", *keys] for law, keys in LAWS.items()),
    *(["controller.law=precomputed", f"controller.precomputed={force}"] for force in FORCES),
    LINE,
    *SENSORS,
]


@pytest.mark.full
def test_laws_and_sensors():
    native, *others = (json.loads(said(name, "-c", PROGRAM, json.dumps(CASES))) for name in FEW)
    assert len(set(native)) > 20
    for other in others:
        assert [case for case, a, b in zip(CASES, native, other, strict=True) if a != b] == []
