"""Short runs of a coarse model, for exchanges by the hundred."""

from functools import cache

from hertzloop.scene.setup import Setup
from tests.hertzloop.scenes import aluminium_3mm

# A coarse model, 2.5 blocks long: the first contact is at the end of the first block.
SHORT = ["run.duration_s=0.0025", "run.accuracy=0.1"]
SCENES = {
    "law": [],
    "converters": [
        "sensors.bits=10",
        "sensors.every_steps=3",
        "controller.latency_us=4",
        "controller.jitter_us=5",
        "controller.drop_out_probability=0.1",
        "controller.bits=8",
        "controller.full_scale_n=60",
        "controller.slew_n_s=2e7",
    ],
    "watching": ["controller.law=predicted", "controller.latency_us=15"],
    "late": ["controller.latency_us=300"],
    "constant": [
        "controller.law=constant",
        "controller.force_n=-20",
        "controller.delay_us=7",
        "controller.duration_us=900",
        "controller.latency_us=2",
    ],
}


@cache
def scene(name: str = "law") -> Setup:
    """A short scene by its name in SCENES."""
    return aluminium_3mm(*SHORT, *SCENES[name])
