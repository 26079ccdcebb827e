"""Results that find no room on a full disk end the command in one sentence."""

import subprocess
from pathlib import Path

import pytest

from tests.hertzloop.processes import HERTZLOOP


@pytest.mark.parametrize("words", [["--version"], ["scene", "show", "oak-20mm"], ["law", "-h"]])
def test_results_that_find_no_room(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*HERTZLOOP, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    said = "error: cannot write standard output: No space left on device"
    assert (done.returncode, done.stderr.strip()) == (1, said)
