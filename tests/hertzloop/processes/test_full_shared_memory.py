"""A full /dev/shm, as in a container: a run needs nothing of it, a sweep says that it does."""

import subprocess

import pytest

from tests.hertzloop.commands import HERTZLOOP

# In a mount namespace of its own; nobody else's is touched.
FULL = [
    "unshare",
    "--mount",
    "--map-root-user",
    "sh",
    "-c",
    "mount -t tmpfs -o size=4k tmpfs /dev/shm && { head -c 8192 /dev/zero > /dev/shm/full; "
    'exec "$@"; } 2>&1',
    "sh",
]


def in_full(*words: str) -> tuple[int, str]:
    """Exit code of a command and what it said, in one line."""
    done = subprocess.run([*FULL, *words], capture_output=True, text=True, timeout=240)
    return done.returncode, " ".join(done.stdout.split())


@pytest.mark.full
def test_a_run_goes_on_and_a_sweep_says_why_it_cannot(tmp_path):
    code, said = in_full("sh", "-c", "! echo more > /dev/shm/more")
    if code:
        pytest.skip(f"no mount namespace of one's own here: {said}")
    short = ["--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1"]
    code, said = in_full(*HERTZLOOP, "run", *short, "--out", str(tmp_path / "a.mcap"))
    assert code == 0, said
    over = ["--over", "controller.kappa=0:1:0.0002", "--workers", "2"]
    code, said = in_full(*HERTZLOOP, "sweep", *over, "--out", str(tmp_path / "a.csv"))
    assert code == 1
    assert "workers cannot be started: No space left on device (they need some room in" in said
    assert "Traceback" not in said
