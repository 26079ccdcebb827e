"""What is drawn in three dimensions: the actuator's place, and its force to scale."""

from typing import Any

import numpy as np
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay import as_rerun, scene3d
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.scene.setup import load
from hertzloop.views import replaying


class Drawn:
    """A stream that keeps what it gets, by entity: components, and columns of them."""

    def __init__(self) -> None:
        self.components: dict[str, dict[str, list[Any]]] = {}
        self.columns: dict[str, list[list[Any]]] = {}

    def log(self, entity: str, archetype: Any, *, static: bool) -> None:
        assert static
        self.components[entity] = {
            batch.component_descriptor().component.split(":")[1]: batch.as_arrow_array().to_pylist()
            for batch in archetype.as_component_batches()
        }

    def send_columns(self, entity: str, indexes: list[Any], columns: Any) -> None:
        self.columns[entity] = [column.as_arrow_array().to_pylist() for column in columns]


def test_the_actuators_force_is_an_arrow_to_scale_at_its_point():
    x, y = np.linspace(0.0, 0.5, 6), np.linspace(0.0, 0.3, 4)
    plate = Deflection(np.arange(4), x, y, np.zeros((4, 6, 4)), (0.25, 0.15))
    drawn = scene3d.scale(plate, (0, 3), 0.003)
    stream: Any = Drawn()
    force_n = np.array([0.0, 10.0, -5.0, np.nan])
    scene3d.send_actuator(stream, force_n, plate, (0.2, 0.1), drawn, 20.0)
    ring = np.array(stream.components["scene/actuator"]["strips"][0])
    np.testing.assert_allclose(ring[:-1, :2].mean(axis=0), (0.2, 0.1), atol=1e-6)
    away = np.hypot(*(ring[:, :2] - (0.2, 0.1)).T)
    np.testing.assert_allclose(away, 1.5 * drawn.sphere_radius_m, rtol=1e-5)
    assert stream.components["scene/actuator/name"]["labels"] == ["actuator, full arrow 20 N"]
    [arrows] = stream.columns["scene/actuator/force"]
    lengths = np.array(arrows)[:, 0, 2]
    np.testing.assert_allclose(np.array(arrows)[:, 0, :2], 0.0)
    # A full one is 0.16 of the shorter side; up is away from the plate.
    np.testing.assert_allclose(lengths, 0.16 * 0.3 * np.array([0.0, 0.5, -0.25, 0.0]), rtol=1e-5)


@given(st.floats(1e-6, 1e9))
def test_a_full_arrow_is_longer_than_any(largest):
    full = scene3d.round_above(largest)
    assert largest * (1 - 1e-9) <= full <= 2.5 * largest * (1 + 1e-9)
    assert f"{full:.3e}"[:5] in ("1.000", "2.000", "5.000")


def test_no_force_around_the_first_contact_is_cut_off(tmp_path, monkeypatch):
    scene = load("aluminium-3mm", ["run.duration_s=0.003"])
    record_in_process(scene, tmp_path / "a.mcap", compiled=True)
    full = []
    monkeypatch.setattr(scene3d, "send_actuator", lambda *given: full.append(given[-1]))
    recording = read(tmp_path / "a.mcap")
    as_rerun.fill(rr.RecordingStream("a"), replaying.prepare(recording, alone=True))
    largest = np.abs(recording.truth.arrays["f_a_n"]).max()
    assert largest <= full[0] <= 2.5 * largest
