"""A full /dev/shm: a run over zenoh needs nothing of it, workers of a sweep say that they do."""

import subprocess
from pathlib import Path

import pytest

from tests.hertzloop.processes import HERTZLOOP

# In a mount namespace of its own; nobody else's is touched.
FULL = ["unshare", "--mount", "--map-root-user", "sh", "-c",
        "mount -t tmpfs -o size=4k tmpfs /dev/shm && { head -c 8192 /dev/zero > /dev/shm/full; "
        'exec "$@"; } 2>&1', "sh"]  # fmt: skip


def in_full(*words: str) -> tuple[int, str]:
    """Exit code of a command and what it said, in one line."""
    done = subprocess.run([*FULL, *words], capture_output=True, text=True, timeout=240)
    return done.returncode, " ".join(done.stdout.split())


@pytest.fixture(autouse=True, scope="module")
def it_can_be_full() -> None:
    code, said = in_full("sh", "-c", "! echo more > /dev/shm/more")
    if code:
        pytest.skip(f"no mount namespace of one's own here: {said}")


def test_a_run_needs_no_shared_memory(tmp_path: Path) -> None:
    short = ["--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1"]
    code, said = in_full(
        *HERTZLOOP, "run", "aluminium-3mm", *short, "--out", str(tmp_path / "a.mcap")
    )
    assert code == 0, said


def test_workers_that_cannot_be_started(tmp_path: Path) -> None:
    words = [
        "--over",
        "controller.kappa=0:1:0.0002",
        "--workers",
        "2",
        "--out",
        str(tmp_path / "a.csv"),
    ]
    code, said = in_full(*HERTZLOOP, "sweep", "aluminium-3mm", *words)
    assert code == 1
    assert "workers cannot be started: No space left on device (they need some room in" in said
    assert "Traceback" not in said
