"""Impacts in the time series of a run: what comes later does not count."""

from dataclasses import asdict

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results.impacts import ImpactMetrics, first_impact, impacts_of
from hertzloop.scene.setup import load
from tests.hertzloop.scenes import aluminium_3mm

SCENES = {
    "bouncing": ("aluminium-3mm", ["run.duration_s=0.12", "controller.law='off'"]),
    "elsewhere": ("offcentre-6mm", ["run.duration_s=0.02"]),
    "published": ("thesis-aluminium", []),
    "always driven": (
        "aluminium-3mm",
        ["run.duration_s=0.02", "controller.law='velocity_feedback'", "controller.kappa=0.01"],
    ),
}


def metrics(found: list[ImpactMetrics]) -> list[dict[str, float]]:
    return [asdict(one.impact) | asdict(one.noise) for one in found]


@pytest.mark.parametrize("name", SCENES)
def test_later_steps_do_not_count(name):
    scene = load(*SCENES[name])
    rows = simulate(scene).truth
    whole = impacts_of(scene, rows)
    assert whole
    assert metrics([first_impact(scene, rows)]) == metrics(whole[:1])
    for number, one in enumerate(whole[:3], 1):
        if one.over + 2 < rows.shape[1]:
            part = impacts_of(scene, rows[:, : one.over + 2])
            assert metrics(part) == metrics(whole[:number])
            assert part[-1].contact_n.tobytes() == one.contact_n.tobytes()


def test_rows_without_a_contact_have_no_first_impact():
    scene = aluminium_3mm()
    rows = simulate(scene, steps=100).truth
    assert first_impact(scene, rows) is None
