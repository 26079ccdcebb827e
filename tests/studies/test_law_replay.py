"""A recording's samples through another law: where the forces differ first."""

import numpy as np

from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import load
from hertzloop.studies.law_replay.law_replay import replay_law, scene_with


def test_it_finds_the_first_step_that_differs_and_none_for_equal_laws(tmp_path):
    setup = load("aluminium-3mm", ["run.duration_s=0.0016", "run.accuracy=0.1"])
    record_in_process(setup, tmp_path / "a.mcap", compiled=True)
    recording = read(tmp_path / "a.mcap")
    equal = replay_law(recording, scene_with(recording, "slope_threshold", {}))
    assert equal.first is None
    assert np.array_equal(equal.recorded_n, equal.other_n)
    other = replay_law(
        recording, scene_with(recording, "slope_threshold", {"controller.kappa": 0.3})
    )
    assert other.first is not None
    assert other.recorded_n[other.first] != other.other_n[other.first]
    assert np.array_equal(other.recorded_n[: other.first], other.other_n[: other.first])
