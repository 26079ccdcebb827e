"""The map of what matters: places known by hand, picture and numbers."""

import pytest

from benchmarks import validity_map as study
from hertzloop.scene.setup import load


def bodies(radius_m: float, thickness_m: float) -> study.MapPlace:
    scene = load("aluminium-3mm")
    found = scene.mechanics.weaker
    assert found is not None
    plate = scene.mechanics.local_plate
    return study.place(scene.mechanics.sphere, plate, radius_m, thickness_m, found[1])


def test_sizes_by_hand():
    small, large = bodies(0.003, 0.003), bodies(0.02, 0.003)
    # 106 of 433 uJ go into the dent at 1.05 GPa; the 20 mm ball stays elastic there.
    assert study.yield_loss(small) == pytest.approx(106.4 / 433.0, rel=0.35)
    assert study.yield_loss(large) == 0.0
    assert study.large_deflection(small) < 1e-3 < study.large_deflection(large)
    # lambda 15: the plate takes m v/Z = 0.85 mm at most, 0.28 of its thickness.
    assert study.large_deflection(large) == pytest.approx(0.28**2, rel=0.1)
