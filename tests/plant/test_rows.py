"""Passes over the steps of a run, beside the same done plainly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.plant.metrics.impacts import contacts
from hertzloop.plant.metrics.noise import modal_drive
from hertzloop.plant.structures.modes import Oscillators

STEP_S = 1e-6


@given(st.lists(st.booleans(), max_size=300))
def test_contacts_are_what_is_not_zero(touching):
    starts, ends = contacts(np.array(touching, float))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching]).astype(int)))
    assert starts == edges[::2].tolist()
    assert ends == edges[1::2].tolist()


@pytest.mark.parametrize(
    ("first", "steps", "frequencies"), [(0, 1, 1), (63, 64, 128), (0, 65, 300), (63, 5000, 128)]
)
def test_a_spectrum_is_the_sum_over_all_steps(first, steps, frequencies):
    draw = np.random.default_rng([first, steps, frequencies])
    force, slope = np.zeros((2, first + steps + 9))
    force[first : first + steps] = draw.normal(size=steps)
    force[first + steps // 2] = 0.0
    slope[first : first + steps] = draw.normal(size=steps)
    hertz = np.sort(draw.uniform(20.0, 4e5, frequencies))
    at_contact, at_actuator = draw.normal(size=(2, frequencies))
    modes = Oscillators(2.0 * np.pi * hertz, at_contact, at_actuator, frequencies, 0.0, 1.0)
    found = modal_drive(modes, STEP_S, np.stack([force, slope]), np.stack([slope, force]))
    a = np.pi * hertz * STEP_S
    turned = np.exp(-2j * np.pi * np.outer(hertz, np.arange(len(force)) * STEP_S))
    held = STEP_S * np.exp(-1j * a) * np.sin(a) / a
    tilted = -1j * STEP_S * np.exp(-1j * a) * (np.sin(a) - a * np.cos(a)) / a**2
    forces, slopes = turned @ force, turned @ slope
    expected = at_contact * (held * forces + tilted * slopes)
    expected += at_actuator * (held * slopes + tilted * forces)
    assert np.max(np.abs(found - expected)) < 1e-12 * STEP_S * steps
