"""Runs in a row, by one process: nothing of them stays behind.

`pytest -m soak -n 0 -s` prints what was held; SOAK_RUNS is how many runs of each way there are.
"""

import gc
import os
import tempfile
from dataclasses import astuple, dataclass
from pathlib import Path

import psutil
import pytest

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import Setup
from hertzloop.views.run_json import run_as_json
from tests.hertzloop.commands import EVENTUALLY_S, wait_for
from tests.hertzloop.short_runs import scene

RUNS = int(os.environ.get("SOAK_RUNS", "40"))
WARM_UP = 10
# A run has 2500 steps with 12 numbers each: 240 kB. Who keeps one a run is found.
LEAST_LEAK = 60_000  # bytes a run
NOISE = 1_000_000  # bytes that the allocator may hold more at one time than at another

pytestmark = [pytest.mark.soak, pytest.mark.timeout(60 + 60 * RUNS)]


@dataclass(frozen=True)
class Held:
    """What this process holds, and has left, between two runs."""

    handles: int
    threads: int
    children: int
    temporary: int
    shared: int


def held(temporary: Path) -> Held:
    gc.collect()
    process = psutil.Process()
    return Held(
        process.num_fds(),
        process.num_threads(),
        len(process.children(recursive=True)),
        len(list(temporary.rglob("*"))),
        sum("hertzloop" in name or "psm_" in name for name in os.listdir("/dev/shm")),
    )


def run_once(short: Setup, folder: Path, transport: Transport, *, shared_memory: bool) -> None:
    options = RunOptions(
        transport,
        overwrite=True,
        timeout_s=EVENTUALLY_S,
        shared_memory=shared_memory,
        realtime="auto",
    )
    report = run_as_json(run_and_assess(short, folder / "run.mcap", options))
    assert report["impacts"] is not None


@pytest.mark.parametrize(
    ("transport", "shared_memory"),
    [
        (Transport.COMPILED, True),
        (Transport.INPROCESS, True),
        (Transport.ZENOH, True),
        (Transport.ZENOH, False),
    ],
)
def test_runs_in_a_row(tmp_path, monkeypatch, transport, shared_memory):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    for _ in range(WARM_UP):
        run_once(scene(), tmp_path, transport, shared_memory=shared_memory)
    before, resident = held(temporary), list[int]()
    for number in range(RUNS):
        run_once(scene(), tmp_path, transport, shared_memory=shared_memory)
        # Threads that hear the last words of processes end by themselves.
        wait_for(lambda: held(temporary).threads <= before.threads)
        assert held(temporary) == before, f"after run {number}"
        resident.append(psutil.Process().memory_info().rss)
    half = RUNS // 2
    grown = max(resident[half:]) - max(resident[:half])
    print(
        f"\n{transport.value}{' in the ring' if shared_memory else ''}: {RUNS} runs after "
        f"{WARM_UP}, {before}, {resident[0] / 1e6:.1f} MB at first, "
        f"{resident[-1] / 1e6:.1f} MB at last, "
        f"most of the second half {grown / 1e6:+.2f} MB against the first"
    )
    # With threads, multiprocessing has a fork server and a tracker of resources, which stay.
    assert before.children in ((0, 2) if transport is Transport.ZENOH else (0,))
    assert astuple(before)[3:] == (0, 0)
    assert grown < NOISE + LEAST_LEAK * half
