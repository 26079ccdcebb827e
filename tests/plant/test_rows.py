"""Compiled passes over rows, beside the same in plain NumPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.plant.metrics.impacts import contacts
from hertzloop.plant.metrics.noise import force_spectrum

STEP_S = 1e-6


@given(st.lists(st.booleans(), max_size=300))
def test_contacts_are_what_is_not_zero(touching):
    starts, ends = contacts(np.array(touching, float))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching]).astype(int)))
    assert starts == edges[::2].tolist()
    assert ends == edges[1::2].tolist()


@pytest.mark.parametrize(
    ("first", "steps", "frequencies"), [(0, 1, 1), (63, 64, 128), (0, 65, 300), (63, 1000, 128)]
)
def test_a_spectrum_is_the_sum_over_all_steps(first, steps, frequencies):
    draw = np.random.default_rng([first, steps, frequencies])
    force, slope = np.zeros((2, first + steps + 9))
    force[first : first + steps] = draw.normal(size=steps)
    force[first + steps // 2] = 0.0
    slope[first : first + steps] = draw.normal(size=steps)
    hertz = np.sort(draw.uniform(20.0, 4e5, frequencies))
    found = force_spectrum(force, STEP_S, hertz, slope)
    a = np.pi * hertz * STEP_S
    turned = np.exp(-2j * np.pi * np.outer(hertz, np.arange(len(force)) * STEP_S))
    held = STEP_S * np.exp(-1j * a) * np.sin(a) / a
    tilted = -1j * STEP_S * np.exp(-1j * a) * (np.sin(a) - a * np.cos(a)) / a**2
    expected = held * (turned @ force) + tilted * (turned @ slope)
    assert np.max(np.abs(found - expected)) < 1e-12 * STEP_S * steps
