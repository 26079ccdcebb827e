"""Where within a sample the sphere first touches: what hangs on it, and what does not."""

from functools import cache

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import XI
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import load
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ("run.duration_s=0.0013",)
PHASES = [(i + 0.5) / 20 for i in range(20)]


@cache
def energies(*settings: str) -> list[float]:
    """Plate energy (dB) of the 3 mm scene over 20 phases."""
    scenes = [aluminium_3mm(*settings, f"run.touch_phase={p}") for p in PHASES]
    return [metrics_of_case(scene).plate_energy_db for scene in scenes]


@pytest.mark.parametrize("phase", [0.25, 0.5, 0.9])
def test_the_touch_comes_that_part_of_a_step_after_a_sample(phase):
    gap = simulate(aluminium_3mm(*SHORT, f"run.touch_phase={phase}")).truth[XI]
    last = int(np.argmax(gap <= 0.0)) - 1
    # Falling by about 0.99 um a step; the contact slows it by less than a per cent at first.
    assert gap[last] / (gap[last] - gap[last + 1]) == pytest.approx(phase, abs=0.01)


def test_without_control_nothing_depends_on_it():
    found = [
        metrics_of_case(aluminium_3mm("controller.law=off", f"run.touch_phase={p}"))
        for p in (0.05, 0.3, 0.5, 0.95)
    ]
    spread = {
        name: np.ptp([getattr(metrics, name) for metrics in found])
        for name in ("plate_energy_j", "contact_us", "rebound_m_s")
    }
    # The scheme's own error at this step is 5e-7 of the gap.
    assert spread["plate_energy_j"] < 3e-6 * found[0].plate_energy_j
    assert spread["contact_us"] < 2e-3  # its ends lie on chords of the gap over a step
    # The rebound is that of the first sample after the contact: a step of gravity.
    assert spread["rebound_m_s"] < GRAVITY_M_S2 * 1e-6


# Mean, least and most over 20 phases, from an independent solver.
@pytest.mark.parametrize(
    ("settings", "mean", "least", "most"),
    [
        ((), 0.17, -0.02, 0.36),
        (("controller.v_thr_m_s=-0.6",), -1.37, -1.49, -0.92),
        (("controller.v_thr_m_s=-0.6", "controller.latency_us=3"), 0.06, -0.02, 0.36),
    ],
)
def test_the_staircase(settings, mean, least, most):
    found = energies(*settings)
    assert np.mean(found) == pytest.approx(mean, abs=0.02)
    assert (min(found), max(found)) == (
        pytest.approx(least, abs=0.02),
        pytest.approx(most, abs=0.02),
    )
    steps = np.abs(np.diff(found))
    assert np.sum(steps > 0.02) == 1  # one step a sample, constant between


def test_random_is_drawn_by_the_seed():
    drawn = [load("aluminium-3mm", ["run.touch_phase=random"], seed=s).run.phase for s in range(50)]
    assert len(set(drawn)) == 50
    assert 0.0 <= min(drawn) < 0.2 < 0.8 < max(drawn) < 1.0
    again = load("aluminium-3mm", ["run.touch_phase=random"], seed=7).run.phase
    assert again == drawn[7]
