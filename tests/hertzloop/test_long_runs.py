"""What a run says in the end takes no memory that grows with its length."""

import subprocess
import sys

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load

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
