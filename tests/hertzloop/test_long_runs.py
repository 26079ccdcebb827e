"""What a run says in the end takes no memory that grows with its length."""

import subprocess
import sys

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results import impacts as impact_windows
from hertzloop.results.impacts import impacts_of_truth, through_first_contact
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load
from tests.hertzloop.test_impact_windows import in_blocks

METRICS = """
import sys
from hertzloop.results import impacts as impact_windows
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.setup import load
from hertzloop.scene.build import free_series
impact_windows.PIECE = 1 << 16  # so that a short run is a long one
scene = load("sylomer-20mm", ["controller.law=off", "run.duration_s=" + sys.argv[1]])
metrics_of(scene, free_series(scene))
# Of this program alone: `resource` counts what the one before it in this process had.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.full
def test_metrics_of_a_long_run_take_no_more_memory() -> None:
    def kilobytes(duration_s: float) -> int:
        words = [sys.executable, "-c", METRICS, str(duration_s)]
        return int(subprocess.check_output(words, text=True, timeout=250))

    kilobytes(2.0)  # compiling, also of what joins pieces, takes memory, which is not meant
    # One contact that does not end; 2 million rows have 160 MB, and their contact force 16 MB.
    assert kilobytes(4.0) - kilobytes(2.0) < 30_000


def test_uncontrolled_rows_are_those_of_a_run_without_control() -> None:
    for name in ("aluminium-20mm", "offcentre-6mm", "thesis-aluminium"):
        scene = load(name, ["controller.law=off"])
        firsts, pieces = zip(*free_series(scene), strict=True)
        assert list(firsts) == [n * pieces[0].shape[1] for n in range(len(pieces))]
        assert np.concatenate(pieces, axis=1).tobytes() == simulate(scene).truth.tobytes()


@pytest.mark.parametrize("law", ["slope_threshold", "force_feedback", "off"])
@pytest.mark.parametrize("piece", [5, 700, 20_000])
def test_metrics_of_blocks_are_those_of_the_whole(
    law: str, piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "offcentre-6mm" if law == "off" else "aluminium-20mm"
    keys = [f"run.duration_s={0.2 if law == 'off' else 0.012}", "plate.loss_factor=0.01"]
    scene = load(name, [*keys, f"controller.law={law}", "sensors.quantity=auto"])
    rows = simulate(scene).truth
    whole = metrics_of(scene, rows)
    assert len(whole.impacts) > 1
    assert metrics_of(scene, in_blocks(rows, 900)).impacts == whole.impacts
    monkeypatch.setattr(impact_windows, "PIECE", piece)
    found = metrics_of(scene, in_blocks(rows, 900))
    for kind in ("impacts", "noise"):
        ours, others = getattr(found, kind), getattr(whole, kind)
        assert len(ours) == len(others)
        for mine, theirs in zip(ours, others, strict=True):
            assert vars(mine) == pytest.approx(vars(theirs), rel=1e-9)
    mine, theirs = ({**vars(one.stability), "since_s": 0.0} for one in (found, whole))
    assert mine == pytest.approx(theirs, rel=1e-9)
    assert found.stability.since_s == whole.stability.since_s


def test_rows_through_the_first_contact() -> None:
    scene = load("aluminium-20mm", ["run.duration_s=0.012"])
    rows = simulate(scene).truth
    first = impacts_of_truth(scene, rows)[0]
    taken = through_first_contact(in_blocks(rows, 120))
    assert first.end + 2 <= taken.shape[1] < rows.shape[1] / 2
    assert taken.tobytes() == rows[:, : taken.shape[1]].tobytes()
