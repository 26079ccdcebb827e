"""A recording of 20 million steps is looked at in 6 GiB: measured on two lengths, and extended."""

import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.scene.setup import load
from tests.recordings.test_untrusted import measured

MILLIONS = (0.5, 1.5)
MOST_BYTES, STEPS = 6 * 2**30, 20.0  # millions


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    found = []
    for length in MILLIONS:
        path = tmp_path_factory.mktemp("memory") / f"{length}.mcap"
        scene = load("aluminium-3mm", [f"run.duration_s={length}", "run.accuracy=0.1"])
        record_in_process(scene, path, compiled=True)
        found.append(path)
    return found


@pytest.mark.full
@pytest.mark.parametrize("command", ["inspect", "replay"])
def test_twenty_million_steps(files, tmp_path, command):
    used = []
    for path in files:
        more = ["--save", tmp_path / f"{path.stem}.rrd"] if command == "replay" else []
        used.append(measured(command, path, *more)[1])
    growth = (used[1] - used[0]) / (MILLIONS[1] - MILLIONS[0])
    expected = used[1] + growth * (STEPS - MILLIONS[1])
    print(f"{command}: {used[0] / 1e6:.0f} and {used[1] / 1e6:.0f} MB, {growth / 1e6:.1f} MB/M")
    assert expected < MOST_BYTES, (used, growth)
