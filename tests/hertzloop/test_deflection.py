"""The plate as a replay shows it, worked out again, against what the plant recorded."""

import math
from pathlib import Path

import numpy as np
import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.plant.metrics.impacts import modal_displacement
from hertzloop.plant.plant import PlantSpec
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.contacts import contact_spans
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.results.deflection import deflection, forces_on_plate, frame_steps
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup, load

SHORT = ["run.duration_s=0.002"]


def replayed(folder: Path, scene: Setup) -> tuple[Recording, Deflection]:
    file = folder / "run.mcap"
    record_in_process(scene, file, compiled=True)
    recording = read(file)
    return recording, deflection(scene, recording)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("aluminium-3mm", SHORT),
        ("offcentre-6mm", [*SHORT, "run.accuracy=1e-2"]),
        ("aluminium-20mm", [*SHORT, "plate.loss_factor=0.05"]),
        ("aluminium-20mm", [*SHORT, "run.lead_in_s=0"]),  # it touches in the first step
    ],
)
def test_the_contact_node_moves_as_recorded(tmp_path: Path, name: str, settings: list[str]) -> None:
    # All modes take part. What is left is rounding: modes of equal frequency are summed apart
    # and several steps are advanced at once. Rows tell the modes apart from a spring for those left
    # out, not from a damped mode.
    scene = load(name, [*settings, "plate.tail=spring"])
    recording, plate = replayed(tmp_path, scene)
    modes = modal_displacement(scene.plant, truth_of(recording))
    recorded = modes[plate.times_ns // recording.truth.step_ns]
    i, j = plate.contact_node
    largest = abs(recorded).max()
    assert largest > 1e-6
    assert abs(plate.w_m[:, i, j] - recorded).max() < 1e-9 * largest


def _of_the_damped_mode(spec: PlantSpec, forces: np.ndarray) -> np.ndarray:
    """Displacement (m) of the mode that stands for those left out, at the start of every step,
    under forces up on the plate, shape (2, steps): mean and slope. The forces over the past steps,
    weighted with the mode's impulse response exp(-a t) (Y cos b t + B sin b t)."""
    plate, h = spec.simply_supported, spec.step_s
    y = 1.0 / plate.infinite_plate_impedance_n_s_m
    left_out = plate.residual_flexibility_m_n(
        2.0 * np.pi * spec.frequency_limit_hz, spec.contact_point_m
    )
    limit = 2.0 * y / (np.pi * left_out)
    a = 0.25 * np.pi * limit
    b = np.sqrt(3.0 * limit**2 - a**2)
    past = np.arange(1, math.ceil(40.0 / (a * h)) + 1)  # steps, until it has died away
    nodes, weights = np.polynomial.legendre.leggauss(40)
    t = h * (past[:, None] - 0.5 * (1.0 + nodes))
    response = np.exp(-a * t) * (
        y * np.cos(b * t) + y * (6.0 * limit / np.pi - a) / b * np.sin(b * t)
    )
    by_mean, by_slope = (0.5 * h * response @ (weights * shape) for shape in (1.0, nodes))
    found = np.convolve(forces[0], by_mean) + np.convolve(forces[1], by_slope)
    return np.concatenate([[0.0], found[: forces.shape[1] - 1]])


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("aluminium-3mm", SHORT),
        ("aluminium-3mm", [*SHORT, "run.accuracy=1e-2"]),
        ("offcentre-6mm", [*SHORT, "run.accuracy=1e-2"]),
        ("aluminium-20mm", [*SHORT, "plate.loss_factor=0.05"]),
    ],
)
def test_with_the_damped_mode_the_contact_node_moves_as_recorded(
    tmp_path: Path, name: str, settings: list[str]
) -> None:
    """What is drawn is the modes; what was recorded has beside it the mode for those left out,
    which no place but the contact has."""
    scene = load(name, settings)
    spec = scene.plant
    assert spec.damped_residual
    recording, plate = replayed(tmp_path, scene)
    forces = forces_on_plate(spec, truth_of(recording))
    tail = _of_the_damped_mode(spec, forces[:2] + (forces[2:] if spec.same_point else 0.0))
    steps = plate.times_ns // recording.truth.step_ns
    recorded = recording.truth.arrays["xi_p_m"][steps]
    i, j = plate.contact_node
    largest = abs(recorded).max()
    assert abs(tail[steps]).max() > 1e-3 * largest  # without it they would differ
    assert abs(plate.w_m[:, i, j] + tail[steps] - recorded).max() < 1e-9 * largest


def test_fewer_modes_than_the_plant_had_cost_accuracy(tmp_path: Path) -> None:
    scene = load("aluminium-3mm", SHORT)
    recording, _ = replayed(tmp_path, scene)
    plate = deflection(scene, recording, per_axis=10)
    recorded = recording.truth.arrays["xi_p_m"][plate.times_ns // recording.truth.step_ns]
    i, j = plate.contact_node
    assert abs(plate.w_m[:, i, j] - recorded).max() > 0.1 * abs(recorded).max()


def test_edges_are_supported_and_a_central_impact_is_symmetric(tmp_path: Path) -> None:
    _, plate = replayed(tmp_path, load("aluminium-3mm", SHORT))
    w, rounding = plate.w_m, 1e-12 * abs(plate.w_m).max()
    for edge in (w[:, 0], w[:, -1], w[:, :, 0], w[:, :, -1]):
        assert abs(edge).max() < rounding
    for mirrored in (w[:, ::-1], w[:, :, ::-1], w.transpose(0, 2, 1)):
        np.testing.assert_allclose(w, mirrored, rtol=0.0, atol=rounding)


def test_the_grid_has_a_node_at_the_contact_point_wherever_it_is(tmp_path: Path) -> None:
    settings = [*SHORT, "plate.contact_point_m=[0.003, 0.41]", "run.accuracy=0.05"]
    _, plate = replayed(tmp_path, load("aluminium-3mm", settings))
    i, j = plate.contact_node
    assert (plate.x_m[i], plate.y_m[j]) == plate.contact_point_m == (0.003, 0.41)
    for axis in (plate.x_m, plate.y_m):
        assert axis[0] == 0.0
        assert axis[-1] == 0.5
        assert np.all(np.diff(axis) > 0.0)


def test_frames_are_dense_at_the_first_contact_and_bounded() -> None:
    xi = np.ones(1_000_000)
    for start in range(5_000, 1_000_000, 20_000):
        xi[start : start + 30] = -1.0
    frames = frame_steps(len(xi), contact_spans(xi))
    assert len(frames) <= 700
    assert np.all(np.diff(frames) > 0)
    assert set(range(5_000, 5_030)) <= set(frames.tolist())
    assert (frames[0], frames[-1]) == (0, 999_999)


def test_a_recording_without_contact_shows_a_plate_at_rest(tmp_path: Path) -> None:
    recording, plate = replayed(tmp_path, load("aluminium-3mm", ["run.duration_s=5e-4"]))
    assert recording.truth.arrays["xi_m"].min() > 0.0
    assert not plate.w_m.any()
    assert frame_steps(1, []).tolist() == [0]
