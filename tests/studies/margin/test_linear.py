"""The transfer function in flight against the compiled kernels, and the margin's known numbers."""

import numpy as np
import pytest

from hertzloop.plant import time_series as ts
from hertzloop.setup import load
from hertzloop.studies.margin.identify import law_filter
from hertzloop.studies.margin.linear import plant_in_flight
from hertzloop.studies.margin.margin import _dense_poles, loop_of, margin_of

VELOCITY = ["controller.law=velocity_feedback", "sensors.quantity=v_p", "controller.kappa=0.4"]


@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("aluminium-20mm", []),
        ("oak-20mm", []),
        ("offcentre-6mm", []),
        ("aluminium-20mm", ["actuator.bandwidth_hz=20000"]),
    ],
)
def test_transfer_function_gives_the_velocity_of_the_kernels(scene, settings):
    setup = load(scene, [*VELOCITY, *settings, "run.lead_in_s=0.01"])
    count = 400
    forces = np.random.default_rng(3).standard_normal(count)
    plant = setup.on_plate("modal").start_plant()
    real = ts.series_under(plant, forces)[ts.V_P]
    form = plant_in_flight(setup, "v_p")
    k = np.arange(count)
    response = np.zeros(count)
    response[1:] = 2.0 * (form.poles[None, :] ** k[:-1, None] @ form.residues).real
    response[1:3] += form.fir
    expected = np.convolve(response, forces)[:count]
    assert np.abs(real - expected).max() <= 1e-12 * np.abs(real).max()


def test_poles_of_aluminium():
    found = margin_of(load("aluminium-20mm", VELOCITY))
    assert (found.stable, found.unstable_poles) == (False, 54)
    assert found.growth_per_s == pytest.approx(1183.0, rel=1e-3)
    assert found.gain_margin == pytest.approx(0.089 / 0.4, rel=5e-3)


def test_windows_open_again():
    found = margin_of(load("aluminium-20mm", [*VELOCITY, "plate.loss_factor=0.01"]))
    assert found.latency_limit_steps == 16
    assert found.latency_limit_us == pytest.approx(16.13, abs=0.005)
    windows = [(int(np.ceil(a)), int(np.floor(b))) for a, b in found.stable_windows_us]
    assert windows == [(0, 16), (19, 19)]


def test_oak_has_a_limit_at_its_resonance():
    found = margin_of(load("oak-20mm", VELOCITY))
    assert found.latency_limit_steps == 497
    assert found.binding_frequency_hz == pytest.approx(791.0, abs=1.0)


@pytest.mark.parametrize(
    "law",
    [
        "slope_threshold",
        "dent_threshold",
        "shifted_threshold",
        "predicted",
        "least_squares",
        "fade_out",
        "precomputed",
        "force_feedback",
        "off",
    ],
)
def test_a_loop_that_is_not_linear_has_no_margin(law):
    found = margin_of(load("aluminium-20mm", [f"controller.law={law}"]))
    assert not found.applicable
    assert found.reason


def test_eigenvalues_agree_with_the_table():
    setup = load("oak-20mm", [*VELOCITY, "controller.kappa=1.1"])
    plant, law = plant_in_flight(setup), law_filter(setup)
    for every, latency in ((1, 0), (1, 5), (3, 0), (3, 4), (3, 7)):
        delay, remainder = divmod(latency + 1, every)
        loop = loop_of(plant, law, every, remainder)
        dense = _dense_poles(loop, delay)
        assert len(dense) == loop.table.unstable(np.array([delay]))[0]
