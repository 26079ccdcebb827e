"""The sensor's automatic range holds the flight that a law has to see; saturation is told."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import Contact, Limit
from hertzloop.plant.contact.yielding import deepest_rigid_m, yielding
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.controller import law_flight_m
from tests.hertzloop.scenes import aluminium_3mm

PREDICTED = ("controller.law=predicted", "run.duration_s=0.0016")


def energy(*settings: str) -> float:
    return metrics_of_case(aluminium_3mm(*PREDICTED, *settings)).plate_energy_db


# Ideal converter: an independent solver's -0.45, -0.50, -0.83 dB.
@pytest.mark.parametrize(("latency_us", "db"), [(0, -0.45), (10, -0.50), (40, -0.83)])
def test_sixteen_bits_over_the_automatic_range_are_ideal(latency_us, db):
    late = f"controller.latency_us={latency_us}"
    assert energy(late) == pytest.approx(db, abs=0.02)
    assert energy(late, "sensors.bits=16") == pytest.approx(db, abs=0.03)
    noisy = ("sensors.bits=16", "sensors.noise_rms=3e-9")  # 1e-4 of the range
    assert energy(late, *noisy) == pytest.approx(db, abs=0.06)


def test_the_range_of_the_contact_alone_is_blind_to_the_flight():
    late = ("controller.latency_us=40", "sensors.bits=16", "sensors.full_scale=contact")
    assert energy(*late) == pytest.approx(0.0, abs=0.01)  # it never acts
    assert aluminium_3mm("sensors.bits=16", "sensors.full_scale=contact").sensor.full_scale == (
        pytest.approx((-11.3e-6, 2.26e-6), rel=0.01)
    )


@pytest.mark.parametrize("latency_us", [0, 5, 40, 300])
def test_the_flight_fits_into_the_range(latency_us):
    settings = (*PREDICTED, "sensors.bits=12", f"controller.latency_us={latency_us}")
    scene = aluminium_3mm(*settings)
    found = scene.sensor.full_scale
    assert 0.0 < law_flight_m(scene) < found[1]
    # And the law is quiet before, so that it costs no exchange a sample.
    run = simulate(scene)
    assert np.all(run.modes[: 980 - 2 * latency_us] == 0)


@pytest.mark.full
def test_a_contact_that_yields_goes_deeper_than_an_elastic_one():
    limit = Limit(0.44e9, 0.003)
    contact = Contact(4.5e9, limit=limit)
    for energy_j in (1e-9, 4.3e-4):
        deepest = deepest_rigid_m(contact, energy_j)
        law = yielding(limit, contact.stiffness)
        beyond = max(deepest - law.delta_m, 0.0)
        taken = 0.4 * contact.stiffness * min(deepest, law.delta_m) ** 2.5
        taken += law.force_n * beyond + 0.5 * law.rise_n_m * beyond**2
        assert taken == pytest.approx(energy_j)
    soft = [
        "contact.plasticity=thornton",
        "contact.limiting_pressure_pa=0.44e9",
    ]
    scene = aluminium_3mm(*soft, "sensors.bits=12", "run.duration_s=0.0013")
    limits = scene.sensor.full_scale
    assert simulate(scene).truth[0].min() > limits[0]
    elastic = aluminium_3mm("sensors.bits=12").sensor.full_scale
    assert simulate(scene).truth[0].min() < elastic[0]  # it would not have done
