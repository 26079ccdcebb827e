"""The transfer function in flight against the compiled kernels, and the margin's known numbers."""

import numpy as np
import pytest

from hertzloop.api.stepper import Stepper
from hertzloop.plant.structures.mode_file import write_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.linear import plant_in_flight

VELOCITY = ["controller.law=velocity_feedback", "sensors.quantity=v_p", "controller.kappa=0.4"]


FILTERS = ["sensors.resonance_hz=60000", "sensors.ac_coupling_hz=500"]
LOW_PASS = ["sensors.low_pass_hz=30000"]
BUTTERWORTH = ["sensors.low_pass_order=8"]
ACTUATOR = ["actuator.bandwidth_hz=20000"]
BY_GAP = ["sensors.quantity=xi", "controller.law=slope_threshold"]
BY_ACCELERATION = ["sensors.quantity=acceleration", "controller.law=acceleration_feedback"]
ELSEWHERE = "sensors.point_m=[0.31,0.22]"
# Sensors beside the contact.
BESIDE = [
    ("offcentre-6mm", [ELSEWHERE]),
    ("offcentre-6mm", [ELSEWHERE, "plate.actuator_point_m=[0.1,0.2]", *ACTUATOR, *FILTERS]),
    ("offcentre-6mm", [ELSEWHERE, *BY_ACCELERATION]),
    ("offcentre-6mm", [ELSEWHERE, "plate.tail=spring", *ACTUATOR]),
]
# Scene, and settings beside velocity feedback.
VARIANTS = [
    ("aluminium-20mm", []),
    ("oak-20mm", []),
    ("offcentre-6mm", []),
    ("aluminium-20mm", ACTUATOR),
    ("aluminium-20mm", LOW_PASS),
    ("aluminium-20mm", ["sensors.ac_coupling_hz=500"]),
    ("aluminium-20mm", ["sensors.resonance_hz=60000"]),
    ("aluminium-20mm", [*BUTTERWORTH, "sensors.low_pass_hz=80000"]),
    ("aluminium-20mm", ["sensors.low_pass=bessel", "sensors.low_pass_order=7", *LOW_PASS]),
    ("aluminium-20mm", [*BUTTERWORTH, *LOW_PASS, *FILTERS, *ACTUATOR, *BY_ACCELERATION]),
    ("aluminium-20mm", [*FILTERS, "sensors.low_pass_hz=30000", *ACTUATOR]),
    ("aluminium-20mm", BY_ACCELERATION),
    ("aluminium-20mm", [*BY_ACCELERATION, *FILTERS, *ACTUATOR]),
    ("aluminium-20mm", BY_GAP),
    ("aluminium-20mm", [*BY_GAP, *FILTERS, *ACTUATOR]),
    ("aluminium-20mm", ["plate.tail=damped"]),
    ("aluminium-20mm", ["plate.tail=spring"]),
    ("aluminium-20mm", ["plate.tail=spring", *BY_GAP]),
    ("aluminium-20mm", ["actuator.mass_kg=0.001"]),
    ("aluminium-20mm", ["plate.tail=spring", *ACTUATOR]),
    *(pytest.param(*one, marks=pytest.mark.full) for one in BESIDE),
]


def samples_under(setup: Setup, forces: np.ndarray) -> np.ndarray:
    """Values that the sensor of a setup samples at the begin of each step."""
    ideal = {"run.plate_model": "modal", "sensors.bits": "ideal", "sensors.full_scale": "auto"}
    plant = Stepper(setup.vary(ideal).scene)
    seen = np.zeros(len(forces))
    for i, force in enumerate(forces):
        seen[i] = plant.sample
        plant.step(float(force))
    return seen


@pytest.mark.parametrize(("scene", "settings"), VARIANTS)
def test_transfer_function_gives_the_samples_of_the_kernels(scene, settings):
    check_transfer(load(scene, [*VELOCITY, "run.lead_in_s=0.01", *settings]))


def test_transfer_function_of_a_file_of_modes(tmp_path):
    table = modes_of_scene(load("aluminium-3mm", ["run.accuracy=0.05"]))
    (tmp_path / "modes.npz").write_bytes(write_modes(".npz", table))
    settings = [*VELOCITY, "run.lead_in_s=0.01", f"plate.modes={tmp_path / 'modes.npz'}"]
    check_transfer(load("aluminium-3mm", settings))


def check_transfer(setup: Setup) -> None:
    """Compare the response to random forces by the kernels and by the transfer function."""
    count = 400
    # Large forces, as the gap is a small difference from that of the flight.
    forces = 1e4 * np.random.default_rng(3).standard_normal(count)
    real = samples_under(setup, forces) - samples_under(setup, np.zeros(count))
    form = plant_in_flight(setup)
    i = np.arange(count)
    response = np.zeros(count)
    response[1:] = (form.poles[None, :] ** i[:-1, None] @ form.residues).real
    response[:3] += form.fir
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
