"""A loop whose latency is not what the scene says must not pass for the same run."""

from pathlib import Path

import pytest

from hertzloop.controller.controller import Controller
from hertzloop.loop import controller_node
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup
from tests.hertzloop.scenes import aluminium_3mm

LATENCY_US = 3


@pytest.fixture
def scene():
    return aluminium_3mm("run.duration_s=0.0015", f"controller.latency_us={LATENCY_US}")


def run(scene: Setup, path: Path) -> Recording:
    record_in_process(scene, path, compiled=False)
    return read(path)


def lie(monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
    """Make the controller's line longer by `steps` (of 1 us); the plant is honest."""
    honest = build_controller

    def dishonest(scene: Setup, ahead: bool = True) -> Controller:
        longer = {"controller.latency_us": scene.latency_us + steps}
        return honest(scene.vary(longer), ahead)

    monkeypatch.setattr(controller_node, "build_controller", dishonest)


@pytest.mark.parametrize("steps", [-1, 1])
def test_compare_notices_a_line_of_another_length(scene, tmp_path, monkeypatch, steps):
    right = run(scene, tmp_path / "right.mcap")
    lie(monkeypatch, steps)
    wrong = run(scene, tmp_path / "wrong.mcap")
    assert str(first_difference(right, wrong)).startswith("daq.value differs first at step 1")
    forced = [r.truth.arrays["f_a_n"].nonzero()[0][0] for r in (right, wrong)]
    assert forced[1] - forced[0] == steps
    # Had only the forces been compared, not the whole loop, it would show as well.
    right.daq, right.truth = wrong.daq, wrong.truth
    assert str(first_difference(right, wrong)).startswith("force.force_n differs")
