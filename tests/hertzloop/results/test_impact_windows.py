"""Metrics of impacts from rows that come in blocks: the same however they are cut."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results import impact_windows
from hertzloop.results.impact_windows import ImpactMetrics
from hertzloop.results.impacts import (
    Block,
    first_impact,
    impacts_of_blocks,
    impacts_of_truth,
)
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


def in_blocks(rows: np.ndarray, size: int) -> Iterator[Block]:
    for first in range(0, rows.shape[1], size):
        yield first, rows[:, first : first + size]


def metrics(found: list[ImpactMetrics]) -> list[dict[str, float]]:
    return [asdict(one.impact) | asdict(one.noise) for one in found]


@pytest.mark.parametrize("name", SCENES)
def test_blocks_do_not_count(name):
    scene = load(*SCENES[name])
    rows = simulate(scene).truth
    whole = impacts_of_truth(scene, rows)
    assert whole
    for size in (1, 7, 1000) if rows.shape[1] < 30_000 else (997,):
        cut = list(impacts_of_blocks(scene, in_blocks(rows, size)))
        assert metrics(cut) == metrics(whole)
        assert [one.contact_n.tobytes() for one in cut] == [o.contact_n.tobytes() for o in whole]


def test_rows_without_a_contact_have_no_first_impact():
    scene = aluminium_3mm()
    rows = simulate(scene, steps=100).truth
    assert first_impact(scene, rows) is None


@pytest.mark.parametrize(("name", "piece"), [("bouncing", 5), ("elsewhere", 64)])
def test_pieces_add_up(name, piece, monkeypatch):
    """Shorter than a contact or longer: sums in another order, nothing else."""
    scene = load(*SCENES[name])
    rows = simulate(scene).truth[:, :8000]
    whole = impacts_of_truth(scene, rows)
    monkeypatch.setattr(impact_windows, "PIECE", piece)
    cut = list(impacts_of_blocks(scene, in_blocks(rows, 1000)))
    assert [(one.start, one.end, one.ended) for one in cut] == [
        (one.start, one.end, one.ended) for one in whole
    ]
    for one, other in zip(metrics(cut), metrics(whole), strict=True):
        assert one == pytest.approx(other, rel=1e-9)


def test_missing_steps_begin_anew():
    """What is left of the second contact has its own time; the first one ends with its part."""
    scene = load(*SCENES["bouncing"])
    rows = simulate(scene).truth
    first, second = impacts_of_truth(scene, rows)[:2]
    hole = (first.start + 3, second.start + 2)
    found = list(impacts_of_blocks(scene, [(0, rows[:, : hole[0]]), (hole[1], rows[:, hole[1] :])]))
    assert [(one.start, one.ended) for one in found[:2]] == [(first.start, False), (hole[1], True)]
    assert found[1].end == second.end
    assert found[1].impact.rebound_speed_m_s == second.impact.rebound_speed_m_s
