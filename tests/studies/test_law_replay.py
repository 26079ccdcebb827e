"""A recording's samples through another law: where the forces differ first."""

import numpy as np
import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.setup import load
from hertzloop.studies.law_replay import replay_law, scene_with
from tests.recordings.rewriting import messages, record, rewrite


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


@pytest.mark.parametrize("number", [0, 2])
def test_samples_behind_a_gap_are_not_fed(tmp_path, number):
    whole = record(tmp_path / "a.mcap")
    lost = [m for m in messages(whole) if m.stream == "daq"][number]
    cut = rewrite(whole, tmp_path / "b.mcap", lambda m: (m.stream, m.number) != ("daq", number))
    recording = read(cut)
    equal = scene_with(recording, "slope_threshold", {})
    if number == 0:
        with pytest.raises(RecordingError, match="the first samples or forces are missing"):
            replay_law(recording, equal)
    else:
        found = replay_law(recording, equal)  # the last sample makes the force of the next step
        assert (len(found.other_n), found.first) == (lost.header.first_step + 1, None)
