"""The kernels are plain Python as well: without compilation they give the same bits."""

import os
import subprocess
import sys
from pathlib import Path

from tests.controller.drive import fingerprint

ROOT = Path(__file__).parents[2]
SCRIPT = """
import numba
from tests.controller.drive import fingerprint
assert numba.config.DISABLE_JIT
print(fingerprint())
"""


def test_compiled_and_uncompiled_give_the_same_bits():
    uncompiled = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert uncompiled.returncode == 0, uncompiled.stderr
    assert uncompiled.stdout.strip() == fingerprint()
