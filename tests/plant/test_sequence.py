"""Contact sequences of whole scenes against metrics of an independent implementation.

Those came from runs that began at first contact, with all modes up to half the sampling
rate, and count the steps in which a force acted: hence the lead-in of zero here. Their
last digit is good to half a unit.
"""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.scene.setup import load

FREE = ["controller.law=off", "contact.damping=none", "run.accuracy=1e-9"]


def contacts(name: str, *settings: str) -> tuple[list[Impact], list[int]]:
    """Contacts of a scene without control, and the steps of each that ends."""
    scene = load(name, [*FREE, "run.lead_in_s=0", *settings])
    rows = simulate(scene).truth
    touching = np.flatnonzero(np.diff(rows[4] != 0.0, prepend=False, append=False))
    return impacts_in(scene.plant, rows), np.diff(touching)[::2].tolist()


def rounded(values: list[float], digits: int) -> list[float]:
    return [round(v, digits) for v in values]


def test_six_contacts_of_the_heavy_ball_on_aluminium():
    found, steps = contacts("aluminium-20mm", "run.duration_s=0.012")
    # The metrics count the steps of a force that is constant over each; here it has a slope, and
    # the first and the last step of a contact may count too.
    counted = [1335, 661, 349, 589, 100, 48]
    assert max(abs(a - b) for a, b in zip(steps, counted, strict=True)) <= 1
    assert rounded([1e3 * i.start_s for i in found], 1) == [0.0, 1.6, 2.4, 8.8, 9.5, 9.8]
    peaks = [i.peak_force_n for i in found]  # mean over a step of a force that moves
    assert peaks == pytest.approx([296, 203, 143, 370, 63, 29], abs=2.0)
    speeds = [-0.203, 0.008, 0.116, 0.427, 0.438, 0.439]
    assert rounded([i.rebound_speed_m_s for i in found], 3) == speeds
    # Counted steps reach past the contact at either end by less than one step.
    durations = [1e6 * i.duration_s for i in found]
    assert all(0.0 <= n - t < 2.0 for n, t in zip(steps, durations, strict=True))


def test_oak_holds_the_heavy_ball_for_milliseconds():
    found, steps = contacts("oak-20mm", "run.duration_s=0.02")
    assert abs(steps[0] - 5651) <= 1
    assert round(found[0].peak_force_n) == 123
    assert round(1e3 * found[1].start_s, 1) == 15.6
