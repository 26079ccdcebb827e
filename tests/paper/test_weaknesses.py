"""Where the published numerics fail, and that the consistent scheme does not."""

import numpy as np
import pytest

from paper import weaknesses


def test_contact_impulse_against_momentum_change():
    for found in weaknesses.momentum():
        if found.scheme == "modal":
            assert found.ratio == pytest.approx(1.0, abs=1e-9), found
        else:
            assert found.ratio < 0.01, found


@pytest.mark.full
def test_the_published_step_does_not_converge_and_the_consistent_one_does():
    found = weaknesses.refinement()
    published = [r for r in found if r.scheme == "thesis2008"]
    # Contact time falls as the square root of the step: the contact mass scales with it.
    times = np.array([r.contact_time_us for r in published])
    np.testing.assert_allclose(times[:-1] / times[1:], np.sqrt(2.0), atol=0.12)
    changes = np.abs(np.diff([r.rebound_m_s for r in published]))
    assert changes[-1] > changes[-2] > changes[-3]
    errors = [r.rebound_error for r in found if r.scheme == "modal"]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(orders - 2.0) < 0.35)
