"""The error that a run under a law expects against all modes, where the force has steps."""

import numpy as np
import pytest

from benchmarks.held_force import outcome


@pytest.mark.full
@pytest.mark.parametrize("law", ["slope_threshold", "constant"])
def test_the_expected_error_covers_the_true_one(law):
    random = np.random.default_rng(5)
    for _ in range(2):
        found = outcome(law, 1e-3, random)
        assert found is not None
        assert found.kept, found
        assert found.expected < 10.0 * found.found, found
