"""Results that find no room on a full disk end the command in one sentence."""

import subprocess
from pathlib import Path

from tests.hertzloop.processes import HERTZLOOP


def test_results_that_find_no_room() -> None:
    words = [*HERTZLOOP, "scene", "show", "oak-20mm"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    said = "error: cannot write standard output: No space left on device"
    assert (done.returncode, done.stderr.strip()) == (1, said)
