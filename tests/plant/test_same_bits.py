"""The bytes of a run do not depend on the processor: of schemes, laws, signal paths and sensors."""

from pathlib import Path

import pytest

from hertzloop.scene.loading import shipped
from tests.processors import FEW, PROCESSORS, run_digests

SCENES = Path(__file__).parents[1] / "scenes"
# Parts of the default scheme that the shipped scenes have not.
PARTS = (
    "actuator-dynamics",
    "hunt-crossley-jitter",
    "infinite",
    "mode-file",
    "sensor-elsewhere",
    "separate-actuator",
    "viscous",
    "yield-large",
    "relaxation",
    "precomputed-thesis",
)

# Under the published scheme, which asks the same of the plant whatever the law.
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


def same(scenes, processors=tuple(PROCESSORS)):
    native, *others = run_digests(scenes, processors).values()
    assert all(other == native for other in others)


def test_a_short_run_on_a_few_processors():
    same([("aluminium-3mm", "run.duration_s=0.0012")], FEW)


@pytest.mark.full
def test_all_parts_on_all_processors():
    other = [(str(SCENES / f"{name}.toml"), "run.duration_s=0.003") for name in PARTS]
    laws = [("thesis-aluminium", "run.duration_s=0.003", *case) for case in CASES]
    same([*((name, "run.duration_s=0.006") for name in shipped()), *other, *laws])
