"""The verdict of a margin comes first, in one sentence."""

from dataclasses import replace

import pytest

from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.result import MarginResult
from hertzloop.studies.margin.sentences import result_lines, verdict_line

STABLE = Margin(True, "", True, 0, 0.0, None, 0.0, 20.0, 76, 76.05, [[0.0, 76.05]], 2.361)


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (STABLE, "stable in flight at 20 us: it tolerates a latency of up to 76.05 us, or 2.361"),
        (
            replace(STABLE, latency_limit_steps=None, latency_limit_us=None, gain_margin=None),
            "it tolerates any latency, or any gain.",
        ),
        (replace(STABLE, stable=None), "Whether the loop is stable at 20 us could not be decided."),
        (
            replace(STABLE, stable=False, unstable_poles=2, growth_per_s=40.0,
                    growth_frequency_hz=4600.0, e_folds=0.4),
            "unstable in flight at 20 us: grows 40/s at 4600 Hz",
        ),
        (Margin(False, "it waits"), "The law has no linear loop in flight, so it has no margin."),
    ],
)  # fmt: skip
def test_the_verdict_is_the_first_line(found, says):
    result = MarginResult(found)
    assert says in verdict_line(result)
    assert result_lines(result)[0] == verdict_line(result)
