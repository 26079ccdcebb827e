"""The plate as a replay shows it, worked out again, against what the plant recorded."""

from pathlib import Path

import numpy as np
import pytest

from hertzloop.plant.metrics.impacts import modal_displacement
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.results.deflection import deflection
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.scenes import aluminium_3mm, recorded

SHORT = ["run.duration_s=0.002"]


def replayed(folder: Path, scene: Setup) -> tuple[Recording, Deflection]:
    recording = recorded(scene, folder / "a.mcap")
    return recording, deflection(scene, recording)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("aluminium-3mm", SHORT),
        ("offcentre-6mm", [*SHORT, "run.accuracy=1e-2"]),
        ("aluminium-20mm", [*SHORT, "plate.loss_factor=0.05"]),
        ("aluminium-20mm", [*SHORT, "run.lead_in_s=0"]),  # it touches in the first step
        (
            "aluminium-3mm",
            [*SHORT, "plate.edges=cfsf", "plate.size_m=[0.4, 0.6]", "run.accuracy=0.02"],
        ),
    ],
)
def test_the_contact_node_moves_as_recorded(tmp_path, name, settings):
    """Rows tell the displacement of the modes from that of a spring, not from that of its mode."""
    scene = load(name, [*settings, "plate.tail=spring"])
    recording, plate = replayed(tmp_path, scene)
    steps = plate.times_ns // recording.truth.step_ns
    moved = modal_displacement(scene.plant, truth_of(recording))[steps]
    assert abs(recording.balance.energy_residual) < 1e-10
    i, j = plate.contact_node
    largest = abs(moved).max()
    assert largest > 1e-7
    assert abs(plate.w_m[:, i, j] - moved).max() < 1e-9 * largest


def test_edges_are_supported_and_a_central_impact_is_symmetric(tmp_path):
    _, plate = replayed(tmp_path, aluminium_3mm(*SHORT))
    w, rounding = plate.w_m, 1e-12 * abs(plate.w_m).max()
    for edge in (w[:, 0], w[:, -1], w[:, :, 0], w[:, :, -1]):
        assert abs(edge).max() < rounding
    for mirrored in (w[:, ::-1], w[:, :, ::-1], w.transpose(0, 2, 1)):
        np.testing.assert_allclose(w, mirrored, rtol=0.0, atol=rounding)


def test_the_grid_has_a_node_at_the_contact_point_wherever_it_is(tmp_path):
    settings = [*SHORT, "plate.contact_point_m=[0.003, 0.41]", "run.accuracy=0.05"]
    _, plate = replayed(tmp_path, aluminium_3mm(*settings))
    i, j = plate.contact_node
    assert (plate.x_m[i], plate.y_m[j]) == plate.contact_point_m == (0.003, 0.41)
    for axis in (plate.x_m, plate.y_m):
        assert axis[0] == 0.0
        assert axis[-1] == 0.5
        assert np.all(np.diff(axis) > 0.0)
