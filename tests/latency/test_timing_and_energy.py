"""The force is late by the programmed latency; after the contact it feeds the plate alone."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.time_series import F_A
from hertzloop.results.cases import metrics_of_case
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0013", "run.accuracy=0.02"]


@pytest.mark.parametrize("law", ["slope_threshold", "force_feedback"])
@pytest.mark.parametrize("latency_us", [1, 30])
def test_the_force_is_late_by_the_latency_and_nothing_else(law, latency_us):
    """With a gain so small that the impact does not feel it, the force is the same, shifted."""
    keys = [*SHORT, f"controller.law={law}", "controller.kappa=1e-9"]
    at_once = simulate(aluminium_3mm(*keys)).truth[F_A]
    late = simulate(aluminium_3mm(*keys, f"controller.latency_us={latency_us}")).truth[F_A]
    assert np.flatnonzero(late)[0] - np.flatnonzero(at_once)[0] == latency_us
    np.testing.assert_allclose(late[latency_us:], at_once[:-latency_us], rtol=1e-5, atol=1e-18)


def test_a_force_after_the_contact_only_feeds_the_plate():
    """At 40 us the ball has left: the plate gains what the actuator gives, the ball nothing."""
    late = metrics_of_case(aluminium_3mm(*SHORT, "controller.latency_us=40"))
    free = metrics_of_case(aluminium_3mm(*SHORT, "controller.law=off"))
    assert late.rebound_percent == pytest.approx(100.0, abs=1e-6)
    assert late.injected_j > 0.0
    gained = late.plate_energy_j - free.plate_energy_j
    assert gained == pytest.approx(late.injected_j, rel=1e-3)
