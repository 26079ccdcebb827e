"""What is said of the time of a sample, and of the latency of the force, against the numbers."""

from pathlib import Path

import numpy as np
import pytest

import hertzloop
from tests.hertzloop.test_cli import call

SHORT = {"run.duration_s": 0.0015}


@pytest.mark.parametrize("quantity", ["xi", "v_p"])
def test_a_value_is_that_of_the_time_of_its_sample(quantity: str) -> None:
    laws = {"xi": "slope_threshold", "v_p": "velocity_feedback"}
    changes = SHORT | {"controller.law": laws[quantity]}
    run = hertzloop.simulate(hertzloop.load("aluminium-3mm", changes))
    unit = "m" if quantity == "xi" else "m_s"
    assert np.array_equal(run.samples.values, run.truth[f"{quantity}_{unit}"].values)
    assert "at the time of the sample" in run.samples.attrs["long_name"]


def test_a_mean_is_that_of_the_step_before_its_sample() -> None:
    changes = SHORT | {"controller.law": "force_feedback"}
    run = hertzloop.simulate(hertzloop.load("aluminium-3mm", changes))
    assert np.array_equal(run.samples.values[1:], run.truth.f_c_n.values[:-1])
    assert "mean of the step before" in run.samples.attrs["long_name"]

    run = hertzloop.simulate(
        hertzloop.load("aluminium-3mm", SHORT | {"controller.law": "acceleration_feedback"})
    )
    velocity = run.truth.v_p_m_s.values
    mean = np.diff(velocity) / 1e-6
    assert run.samples.values[1:] == pytest.approx(mean, rel=1e-6, abs=1e-6 * np.abs(mean).max())
    assert "mean of the step before" in run.samples.attrs["long_name"]


def test_the_details_of_a_run_have_the_mean_latency_under_jitter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    short = ("run", "aluminium-3mm", "--set", "run.duration_s=0.0015", "--details", "--transport")
    done = call(*short, "inprocess", "--set", "controller.jitter_us=20", "--out", "a.mcap")
    assert done.exit_code == 0, done.output
    (row,) = [line for line in done.output.splitlines() if "mean latency" in line]
    assert 15.0 < float(row.split("mean latency")[1].strip(" │").split()[0]) < 16.0, row
    done = call(*short, "inprocess", "--out", "b.mcap")
    assert "mean latency" not in done.output
