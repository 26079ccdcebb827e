"""The same bits however many threads linear algebra had before hertzloop came."""

import os
import subprocess
import sys

import pytest

from hertzloop.results.cases import figures_of_case
from hertzloop.scenes.scene import load

SETTINGS = ["run.duration_s=0.002", "run.accuracy=0.05", "plate.edges=cffs"]
SCRIPT = f"""
import numpy  # before hertzloop can ask for one thread
from hertzloop.results.cases import figures_of_case
from hertzloop.scenes.scene import load
from threadpoolctl import threadpool_info
print(max(found["num_threads"] for found in threadpool_info()))
print(figures_of_case(load("aluminium-3mm", {SETTINGS})).digest)
print(max(found["num_threads"] for found in threadpool_info()))
"""


@pytest.mark.usefixtures("warm_kernels")
def test_a_plate_is_the_same_where_numpy_came_first() -> None:
    if (os.cpu_count() or 1) < 2:
        pytest.skip("one core: NumPy has one thread anyway")
    unasked = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=unasked | {"OMP_NUM_THREADS": "2"},
                          capture_output=True, text=True, timeout=280)  # fmt: skip
    assert done.returncode == 0, done.stderr
    before, digest, after = done.stdout.split()
    assert digest == figures_of_case(load("aluminium-3mm", SETTINGS)).digest
    assert before == after == "2"  # what the caller has is left alone
