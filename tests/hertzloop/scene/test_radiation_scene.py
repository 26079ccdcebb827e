"""Radiation of a scene: energies by their names."""

import math

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results.metrics import metrics_of
from tests.hertzloop.scenes import aluminium_3mm

pytestmark = pytest.mark.full

SHORT = "run.duration_s=0.0016"


def noise_of(*settings: str) -> dict[str, float]:
    scene = aluminium_3mm(SHORT, *settings)
    return vars(metrics_of(scene, simulate(scene).truth).noise[0])


def test_what_is_radiated_beside_the_metric_of_the_study():
    """Metric of the study and real energy, without control; change by the default law."""
    free, controlled = noise_of("controller.law=off"), noise_of()
    wanted = {
        "radiated_j": (167.0, -1.17),
        "radiated_maidanik_j": (267.0, -2.18),
        "sound_j": (176.0, -2.01),
        "sound_maidanik_j": (187.0, -2.15),
    }
    for key, (energy_uj, change_db) in wanted.items():
        assert 1e6 * free[key] == pytest.approx(energy_uj, abs=0.6), key
        change = 10.0 * math.log10(controlled[key] / free[key])
        assert change == pytest.approx(change_db, abs=0.01), key
    # The metric of the study is no energy: there are 209.4 uJ below 20 kHz.
    assert free["radiated_maidanik_j"] > 209.4e-6 > free["sound_maidanik_j"]
