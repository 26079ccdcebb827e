"""The force is late by the programmed latency; after the contact it feeds the plate alone."""

import pytest

from hertzloop.results.cases import metrics_of_case
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0013", "run.accuracy=0.02"]


def test_a_force_after_the_contact_only_feeds_the_plate():
    """At 40 us the ball has left: the plate gains what the actuator gives, the ball nothing."""
    late = metrics_of_case(aluminium_3mm(*SHORT, "controller.latency_us=40"))
    free = metrics_of_case(aluminium_3mm(*SHORT, "controller.law=off"))
    assert late.rebound_percent == pytest.approx(100.0, abs=1e-6)
    assert late.injected_j > 0.0
    gained = late.plate_energy_j - free.plate_energy_j
    assert gained == pytest.approx(late.injected_j, rel=1e-3)
