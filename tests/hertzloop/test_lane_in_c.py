"""The example controller in C on the fast lane: the same bytes as ours, and a named end."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

from hertzloop.bus import lane, lane_kernels
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.recordings.reader import read
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import load
from tests.hertzloop.processes import finish, grown_to, start, wait_for
from tests.ports import free_ports
from tests.tiers import default

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
SETTINGS = ["controller.law=force_feedback", "controller.kappa=0.4", "controller.latency_us=2"]

needs_cc = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The example's program and messages, as environment."""
    folder = tmp_path_factory.mktemp("lane")
    words = ["cc", "-O2", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    program = folder / "lane_controller"
    source = EXAMPLES / "lane_controller.c"
    subprocess.run([*words, "-I", ROOT / "bus", "-o", program, source], check=True)
    shutil.copy(ROOT / "bus" / "messages.proto", folder)
    protoc = ["-m", "grpc_tools.protoc", "-I.", "--python_out=.", "messages.proto"]
    subprocess.run([sys.executable, *protoc], cwd=folder, check=True)
    path = os.pathsep.join([str(folder), str(EXAMPLES)])
    return {**os.environ, "LANE_CONTROLLER": str(program), "PYTHONPATH": path}


@contextmanager
def run(example: dict[str, str], recording: Path, *words: str) -> Iterator[list[subprocess.Popen]]:
    """Plant, recorder, and the example; none of them is left."""
    a, b, c = (f"tcp/127.0.0.1:{port}" for port in free_ports(3))
    bus = ["--name", f"in-c-{os.getpid()}"]
    ours = [*bus, "--wait", "240", "--timeout", "30"]
    settings = [word for key in (*SETTINGS, *words) for word in ("--set", key)]
    started = [
        start("node", "plant", "aluminium-3mm", *ours, "--listen", a, *settings),
        start("node", "recorder", *ours, "--out", str(recording), "--listen", c, "--connect", a,
              "--connect", b),
        subprocess.Popen(
            [sys.executable, EXAMPLES / "lane_controller.py", *bus, "--listen", b, "--connect", a,
             "--wait", "240"],
            env=example, text=True, stderr=subprocess.PIPE,
        ),
    ]  # fmt: skip
    try:
        yield started
    finally:
        for process in started:
            process.kill()
            process.communicate()


@needs_cc
@pytest.mark.parametrize("every", default([1, 3], [3]))
def test_the_same_forces(example: dict[str, str], tmp_path: Path, every: int) -> None:
    more = ["run.duration_s=0.0055", f"sensors.every_steps={every}"]
    with run(example, tmp_path / "c.mcap", *more) as processes:
        for process in processes:
            code, err, _ = finish(process)
            assert code == 0, err
    ours = load("aluminium-3mm", [*SETTINGS, *more])
    run_and_assess(ours, tmp_path / "ours.mcap", RunOptions(transport=Transport.COMPILED))
    found, expected = read(tmp_path / "c.mcap"), read(tmp_path / "ours.mcap")
    assert not found.problems
    for stream in ("daq", "force", "truth"):
        theirs, arrays = (getattr(r, stream).arrays for r in (found, expected))
        for name, values in arrays.items():
            assert np.array_equal(theirs[name], values), name
    assert expected.force.arrays["force_n"].any()


@needs_cc
@pytest.mark.full
def test_a_program_that_is_killed_is_named(example: dict[str, str], tmp_path: Path) -> None:
    recording = tmp_path / "c.mcap"
    with run(example, recording, "run.duration_s=15") as (plant, recorder, controller):
        wait_for(grown_to(recording, 500_000))
        [program] = psutil.Process(controller.pid).children()
        program.send_signal(signal.SIGKILL)
        code, err, _ = finish(plant)
        assert code == 1
        assert "the controller in C ended with -9" in err
        for process in (recorder, controller):
            finish(process)
        assert not program.is_running()


def test_the_header_has_the_same_layout() -> None:
    text = (ROOT / "bus" / "hertzloop_lane.h").read_text()
    offsets = {name: int(at) for name, at in re.findall(r"(\w+);\s*/\* (\d+):", text)}
    words = {
        "run_id": lane_kernels.RUN_ID,
        "slots": lane_kernels.SLOTS,
        "steps": lane_kernels.STEPS,
        "every_steps": lane_kernels.EVERY_STEPS,
        "joined": lane_kernels.JOINED,
        "closed": lane_kernels.CLOSED,
        "answers_taken": lane_kernels.ANSWERS_TAKEN,
    }
    assert {name: offsets[name] for name in words} == {n: 8 * w for n, w in words.items()}
    assert f"{lane.MAGIC:#x}" in text
