"""Energies of a replay: a hammer keeps that with which it left, when a hand withdraws it."""

import numpy as np

from hertzloop.plant.time_series import XI
from hertzloop.results.energy_history import energy_histories
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load


def test_a_hammer_that_was_withdrawn_keeps_its_energy():
    setup = load(
        "aluminium-3mm",
        [
            "hammer.mass_kg=0.1",
            "hammer.speed_m_s=0.5",
            "hammer.tip_stiffness=1e7",
            "hammer.tip_exponent=1",
            "controller.law=off",
            "run.duration_s=0.0025",
            # A kind of plant that tests/plant/test_hammer.py compiles, too.
            "plate.tail=spring",
        ],
    )
    rows = np.concatenate([block for _, block in free_series(setup)], axis=1)
    blocks = [(i, rows[:, i : i + 100]) for i in range(0, rows.shape[1], 100)]
    parts = [energies for _, _, energies in energy_histories(setup, blocks)]
    sphere, plate, contact = (
        np.concatenate([getattr(one, name) for one in parts])
        for name in ("sphere", "plate", "contact")
    )
    touching = np.flatnonzero(rows[XI] < 0.0)
    after = slice(touching[-1] + 2, None)
    assert np.ptp(sphere[after]) == 0.0
    assert abs(sphere[-1] + plate[-1] - sphere[0]) < 1e-2 * sphere[0]
    assert np.max(np.abs(contact[after])) < 1e-2 * sphere[0]
