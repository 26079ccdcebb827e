"""Figures of a case: over the length of time that they are said to be over."""

import pytest

from hertzloop.cases import figures_of_case
from hertzloop.compiled import simulate
from hertzloop.impact_rows import consistent_impacts
from hertzloop.scene import load

SHORT = ["run.accuracy=0.05", "run.duration_s=0.0018", "run.plate_model=modal"]


@pytest.mark.parametrize("line", [[], ["controller.slew_n_s=2e6"], ["sensors.every_steps=5"]])
@pytest.mark.parametrize("latency_us", [90, 120, 300])
def test_a_force_long_after_the_contact_counts_in_full(latency_us: int, line: list[str]) -> None:
    scene = load("aluminium-3mm", [*SHORT, *line, f"controller.latency_us={latency_us}"])
    impact, run = figures_of_case(scene, "impact"), figures_of_case(scene, "run")
    assert impact.injected_j > 1e-5
    assert impact.plate_energy_db == pytest.approx(run.plate_energy_db, abs=1e-9)
    assert impact.steps < run.steps


def test_a_case_that_never_ends_is_compared_with_as_long_a_run_without_control() -> None:
    keys = ["run.accuracy=0.05", "run.duration_s=0.006", "controller.kappa=0.3"]
    scene = load("aluminium-20mm", [*keys, "controller.law=velocity_feedback"])
    figures = figures_of_case(scene, "impact")
    free = scene.without_control()
    contacts = consistent_impacts(free, simulate(free).rows)
    assert figures.steps == scene.steps
    assert len(contacts) > 1
    change = figures.plate_energy_j / sum(c.plate_energy_j for c in contacts)
    assert 10.0 ** (0.1 * figures.plate_energy_db) == pytest.approx(change, rel=1e-9)


def test_a_delay_of_zero_is_a_delay() -> None:
    """A threshold below the impact speed is crossed by the first sample in contact."""
    keys = ["run.accuracy=0.1", "run.duration_s=0.0013"]
    at_once = figures_of_case(load("aluminium-3mm", [*keys, "controller.v_thr_m_s=-2"]))
    assert at_once.delay_us == 0.0
    off = figures_of_case(load("aluminium-3mm", [*keys, "controller.law=off"]))
    assert off.delay_us != off.delay_us  # nan
