"""The bytes of a run do not depend on the processor."""

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


def same(scenes, processors=tuple(PROCESSORS)):
    native, *others = run_digests(scenes, processors).values()
    assert all(other == native for other in others)


def test_a_short_run_on_a_few_processors():
    same([("aluminium-3mm", "run.duration_s=0.0012")], FEW)


@pytest.mark.full
def test_all_shipped_scenes_and_other_parts_on_all_processors():
    other = [(str(SCENES / f"{name}.toml"), "run.duration_s=0.003") for name in PARTS]
    same([*((name, "run.duration_s=0.006") for name in shipped()), *other])
