"""A study that is killed, and one that is interrupted; long series: see `tests.faults.studies`."""

import signal

import pytest

from tests.faults.studies import hit, whole


@pytest.mark.full
@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize(  # sweeps: test_interrupted_sweeps.py
    ("study", "sent"), [("budget", signal.SIGKILL), ("tune", signal.SIGINT)]
)
def test_a_study_that_is_cut_short_ends_as_if_it_was_not(study, sent, tmp_path):
    expected, lasts_s = whole(study, tmp_path / "whole")
    found = hit(study, sent, 0.7 * lasts_s, expected, tmp_path / "hit")
    assert found.wrong == [], found
