"""A study that is killed, and one that is interrupted; long series: see `tests.faults.studies`."""

import pytest

from tests.faults.studies import Cut, hit


@pytest.mark.full
@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize(  # sweeps: test_interrupted_sweeps.py
    "cut", [Cut("budget", "SIGKILL", 0.4), Cut("tune", "SIGINT", 0.4)], ids=str
)
def test_a_study_that_is_cut_short_ends_as_if_it_was_not(cut, tmp_path):
    outcome = hit(cut, tmp_path)
    assert outcome.wrong == [], outcome
