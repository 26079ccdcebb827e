"""The example controller in C in shared memory: the same bytes as ours, and a named end."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from hertzloop.bus import ring_kernels, shared_memory
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.recordings.reader import read
from tests.commands import as_options
from tests.hertzloop.commands import Bus, ended, finish, grown_to, killed_at_the_end, wait_for
from tests.hertzloop.own_laws import EXAMPLES, ROOT, needs_cc
from tests.hertzloop.scenes import aluminium_3mm, recorded
from tests.tiers import default

SETTINGS = ["controller.law=force_feedback", "controller.kappa=0.4", "controller.latency_us=2"]


@pytest.fixture(scope="module")
def example(messages, tmp_path_factory):
    """The example's program and messages, as environment."""
    program = tmp_path_factory.mktemp("lane") / "ring_controller"
    words = ["cc", "-O2", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    source = EXAMPLES / "ring_controller.c"
    subprocess.run([*words, "-I", ROOT / "bus", "-o", program, source], check=True)
    path = os.pathsep.join([str(messages), str(EXAMPLES)])
    return {**os.environ, "RING_CONTROLLER": str(program), "PYTHONPATH": path}


@contextmanager
def run(example: dict[str, str], recording: Path, *words: str) -> Iterator[list[subprocess.Popen]]:
    """Plant, recorder, and the example."""
    bus, patience = Bus(f"in-c-{os.getpid()}"), ["--timeout", "30"]
    plant = ["aluminium-3mm", *as_options([*SETTINGS, *words]), *patience]
    started = [
        bus.start(PLANT, *plant, wait_s=240.0),
        bus.start(RECORDER, "--out", str(recording), *patience, wait_s=240.0),
        subprocess.Popen(
            [sys.executable, EXAMPLES / "ring_controller.py", *bus.words(CONTROLLER, 240.0)],
            env=example,
            text=True,
            stderr=subprocess.PIPE,
        ),
    ]
    with killed_at_the_end(started):
        yield started


@pytest.mark.full
@needs_cc
@pytest.mark.parametrize("every", default([1, 3], [3]))
def test_the_same_forces(example, tmp_path, every):
    more = ["run.duration_s=0.0055", f"sensors.every_steps={every}"]
    with run(example, tmp_path / "c.mcap", *more) as processes:
        for process in processes:
            ended(process)
    ours = aluminium_3mm(*SETTINGS, *more)
    found, expected = read(tmp_path / "c.mcap"), recorded(ours, tmp_path / "ours.mcap")
    assert not found.problems
    for stream in ("daq", "force", "truth"):  # it publishes no events
        theirs, arrays = (getattr(one, stream).arrays for one in (found, expected))
        assert {name: values.tobytes() for name, values in theirs.items()} == {
            name: values.tobytes() for name, values in arrays.items()
        }
    assert expected.force.arrays["force_n"].any()


@needs_cc
@pytest.mark.full
def test_a_program_that_is_killed_is_named(example, tmp_path):
    recording = tmp_path / "c.mcap"
    with run(example, recording, "run.duration_s=15") as (plant, recorder, controller):
        wait_for(grown_to(recording, 500_000))
        [program] = psutil.Process(controller.pid).children()
        program.send_signal(signal.SIGKILL)
        ended(plant, 1, "the controller in C ended with -9")
        for process in (recorder, controller):
            finish(process)
        assert not program.is_running()


def test_the_header_has_the_same_layout():
    text = (ROOT / "bus" / "hertzloop_ring.h").read_text()
    offsets = {name: int(at) for name, at in re.findall(r"(\w+);\s*/\* (\d+):", text)}
    names = "run_id", "slots", "steps", "every_steps", "joined", "closed", "answers_taken"
    words = {name: 8 * getattr(ring_kernels, name.upper()) for name in names}
    assert {name: offsets[name] for name in names} == words
    assert f"{shared_memory.MAGIC:#x}" in text
