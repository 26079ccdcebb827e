"""Filter, sampling, noise and quantities of a channel, on made-up signals and on a plant."""

import math

import numpy as np
import pytest

from hertzloop.closed_loop.parts import series_under
from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import build_plant
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup, load
from hertzloop.sensors import kernels as k
from hertzloop.sensors.acquisition import Sensor, SensorSpec

STEP_S = 1e-6


def record(spec: SensorSpec, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and flags of a channel without sampling: one for every value of `signal`."""
    sensor = Sensor(spec, STEP_S, len(signal), 1)
    out, flags = np.empty(len(signal)), np.empty(len(signal), bool)
    for i, value in enumerate(signal):
        k.follow(sensor.model, sensor.state, value)
        _, out[i], flags[i] = k.sample(sensor.model, sensor.state, i)
    return out, flags


def run(*settings: str) -> tuple[np.ndarray, np.ndarray]:
    """Time series and sampled values of a scene without control."""
    found = simulate(scene(*settings))
    return found.truth, found.values


def scene(*settings: str) -> Setup:
    """A whole contact of the light ball in half a millisecond."""
    fixed = ["run.duration_s=0.0005", "run.lead_in_s=0.0002", "run.accuracy=0.05"]
    return load("aluminium-3mm", ["controller.law=off", *fixed, *settings])


@pytest.mark.parametrize("every", [1, 3, 600])
def test_every_nth_step_is_sampled_from_the_first_on(every):
    truth, values = run(f"sensors.every_steps={every}")
    assert np.array_equal(values, truth[0][::every])


def test_each_quantity_is_read_from_its_own_place():
    read = {name: run(f"sensors.quantity={name}") for name in SENSED}
    truth = read["xi"][0]
    xi, _, _, v_p, f_c, *_ = truth
    assert f_c.max() > 50.0  # there was a contact
    assert np.array_equal(read["xi"][1], xi)
    assert np.array_equal(read["v_p"][1], v_p)
    # Of the last step: the contact force over it, and the mean acceleration.
    assert np.array_equal(read["contact_force"][1], np.append(0.0, f_c[:-1]))
    assert np.array_equal(
        read["acceleration"][1], np.append(0.0, np.diff(v_p) / scene().run.step_s)
    )


def test_velocity_is_a_value_at_the_end_of_the_step_and_acceleration_a_mean(tmp_path):
    """One undamped mode of 1 kg under a force held from the start: v = F/w sin(w t) in closed form.
    The mean velocity of the first step is half of that at its end."""
    hertz, force_n, step_s = 20e3, 3.0, 5e-6
    file = tmp_path / "one.csv"
    file.write_text(
        "# residual_flexibility_m_n = 0\nfrequency_hz,loss_factor,modal_mass_kg,shape_contact\n"
        f"{hertz},0,1,1\n"
    )
    # A sphere so large that its contact would be long enough for this mode.
    settings = ["sphere.radius_m=0.02", "run.step_ns=5000"]
    plant = build_plant(scene(f"plate.modes='{file}'", *settings))
    omega = 2.0 * math.pi * hertz
    t = step_s * np.arange(13)
    at_ends, moved = force_n / omega * np.sin(omega * t), 1.0 - np.cos(omega * t)
    means = np.diff(force_n / omega**2 * moved) / step_s
    assert means[0] == pytest.approx(0.5 * at_ends[1], rel=0.1)
    read, truth = {"v_p": [], "acceleration": []}, []
    for _ in t[1:]:
        truth.append(series_under(plant, np.array([force_n]))[3, 0])
        for name, values in read.items():
            values.append(float(plant.state.body[SENSED[name].of_state]))
    assert read["v_p"] == pytest.approx(at_ends[1:], rel=1e-9, abs=1e-15)
    assert truth == pytest.approx(at_ends[:-1], rel=1e-9, abs=1e-15)
    assert read["acceleration"] == pytest.approx(np.diff(at_ends) / step_s, rel=1e-9, abs=1e-9)


def test_filter_sees_every_step_also_between_samples():
    truth, values = run("sensors.every_steps=7", "sensors.low_pass_hz=20000")
    assert np.array_equal(values, record(SensorSpec(low_pass_hz=20e3), truth[0])[0][::7])


def test_noise_comes_before_the_converter():
    clean = run()[1]
    noisy = run("sensors.noise_rms=1e-6")[1]
    drawn = Sensor(SensorSpec(noise_rms=1e-6), STEP_S, 500, load("aluminium-3mm").run.seed)
    assert np.array_equal(noisy, clean + drawn.model.noise)
    settings = ["sensors.bits=10", "sensors.full_scale=[-2e-5, 1e-3]"]
    coded = run("sensors.noise_rms=1e-6", *settings)[1]
    inside = np.clip(noisy, -2e-5, 1e-3)
    step = 1.02e-3 / 1023
    assert abs(coded - inside).max() <= 0.5 * step * (1.0 + 1e-9)
