"""What is heard of a run: files on one scale, silence, rate, and what control does to the sound."""

import math
import wave

import numpy as np
import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.results import listening
from hertzloop.scene.setup import load
from tests.commands import refused, succeed
from tests.hertzloop.scenes import aluminium_3mm, json_in

SHORT = [
    "run.duration_s=0.004",
    "run.accuracy=0.05",
    "plate.size_m=[0.2, 0.16]",
    "plate.contact_point_m=[0.09, 0.07]",
]


def samples_of(path: str) -> tuple[int, np.ndarray]:
    with wave.open(path) as file:
        assert (file.getnchannels(), file.getsampwidth()) == (1, 2)
        data = np.frombuffer(file.readframes(file.getnframes()), "<i2")
        return file.getframerate(), data


@pytest.fixture(scope="module")
def heard(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heard")
    record_in_process(load("aluminium-20mm", SHORT), folder / "a.mcap", compiled=True)
    out = ["-o", folder / "x", "--tail", 0.1, "--json", folder / "x.json"]
    told = succeed("listen", folder / "a.mcap", *out)
    data = json_in(folder / "x.json")
    assert data["runs"]["with-control"]["file"] in told
    assert "Sound on the axis, 1 m from the plate" in told
    return data


def test_both_files_have_one_scale_and_no_clipped_sample(heard):
    largest = {}
    for name, run in heard["runs"].items():
        rate, samples = samples_of(run["file"])
        assert rate == 48_000
        assert len(samples) == math.ceil(0.104 * 48_000 / 480) * 480
        pressure = samples / 32767.0 * heard["full_scale_pa"]
        half_a_step = 0.51 * heard["full_scale_pa"] / 32767.0
        assert abs(np.abs(pressure).max() - run["peak_pa"]) <= half_a_step
        exposure = float(np.sum(pressure**2)) / 48_000
        assert exposure == pytest.approx(run["exposure_pa2_s"], rel=1e-3)
        largest[name] = int(np.abs(samples).max())
    assert max(largest.values()) == round(0.9 * 32767)


def test_modes_move_the_volumes_that_are_known_in_closed_form():
    """Of sin(m pi x/a) sin(n pi y/b): 4 a b/(m n pi^2) if m and n are odd, else none."""
    setup = aluminium_3mm(*SHORT)
    radiator, plate = listening.radiator_of(setup), setup.plant.plate.simply_supported
    m, n, omega = plate.mode_numbers(float(radiator.omega.max()) * (1.0 + 1e-9))
    a, b = plate.size_m
    odd = (m % 2 == 1) & (n % 2 == 1)
    expected = (4.0 * a * b / (m * n * np.pi**2))[odd]
    found = abs(radiator.volume_m2)
    assert np.sort(radiator.omega) == pytest.approx(np.sort(omega[odd]))
    assert np.sort(found) == pytest.approx(np.sort(expected), abs=0.01 * expected.max())


def test_nothing_moves_nothing_sounds(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the sounds go there
    scene = load("aluminium-20mm", [*SHORT, "run.duration_s=0.0005", "controller.law=off"])
    record_in_process(scene, tmp_path / "a.mcap", compiled=True)
    assert "Silence" in succeed("listen", tmp_path / "a.mcap", "--tail", 0)
    refused("Invalid value for '--distance'", "listen", tmp_path / "a.mcap", "--distance", -1)
    _, samples = samples_of(str(tmp_path / "a-without-control.wav"))
    assert len(samples)
    assert not samples.any()


def test_slower_is_the_same_sound_at_a_lower_pitch():
    scene = load("aluminium-20mm", SHORT)
    fast, slow = listening.grid_of(scene, 0.01), listening.grid_of(scene, 0.01, slow=4.0)
    assert slow.step_s == pytest.approx(fast.step_s / 4.0)
    assert abs(slow.count * slow.step_s - fast.count * fast.step_s) < 480 * fast.step_s
    assert slow.up_to_hz == pytest.approx(fast.up_to_hz, rel=2e-3)
    for grid in (fast, slow):  # what sounds is not faded out
        assert grid.band()[grid.s.imag <= 2.0 * math.pi * 19.9e3].min() == 1.0
