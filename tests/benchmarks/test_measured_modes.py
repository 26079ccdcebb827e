"""The bound of the accuracy of identified modes, against derivatives by differences."""

import numpy as np

from benchmarks.measured_modes import bounds, response
from hertzloop.plant.structures.mode_file import ModeTable

OMEGA, LOSS = 2.0 * np.pi * np.array([200.0, 206.0, 350.0]), np.array([0.02, 0.03, 0.01])
CONTACT, OTHER = np.array([1.0, 0.7, 1.2]), np.array([-0.5, 0.9, 0.4])


def test_the_bound_is_that_of_the_responses_slopes():
    hz, n = np.arange(150.0, 400.0, 1.0), len(OMEGA)
    noise = [np.full(len(hz), 0.01), np.linspace(0.01, 0.03, len(hz))]

    def responses(logs: np.ndarray) -> np.ndarray:
        omega, loss, contact, other = np.exp(logs).reshape(4, n) * [OMEGA, LOSS, CONTACT, OTHER]
        table = ModeTable(omega, loss, np.ones(n), contact, other)
        both = [
            response(table, hz, one, 2) / size
            for one, size in zip((contact, other), noise, strict=True)
        ]
        return np.concatenate([part for one in both for part in (one.real, one.imag)])

    steps = 1e-6 * np.eye(4 * n)
    slopes = np.array([(responses(step) - responses(-step)) / 2e-6 for step in steps])
    covariance = np.linalg.inv(2.0 * slopes @ slopes.T)  # each part has half the variance
    table = ModeTable(OMEGA, LOSS, np.ones(n), CONTACT, OTHER)
    found = bounds(table, hz, (CONTACT, OTHER), 2, noise)
    assert np.allclose(found.ravel(), np.sqrt(np.diag(covariance)), rtol=1e-5)
    alone = bounds(table, hz, (CONTACT,), 2, noise[:1])
    assert np.all(alone[:2] > found[:2])
    assert np.array_equal(alone[2], alone[3])
