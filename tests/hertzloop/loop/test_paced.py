"""Paced mode: the wall clock sets the step, late forces act when they come, and a recording of that
repeats in lock-step to the bit."""

import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.closed_loop import clock
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.repeated_run import repeated_run
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.results.recorded import class_ends_ns, pacing_of
from hertzloop.scene.setup import Setup
from tests.commands import as_options, refused
from tests.hertzloop.commands import (
    child_of,
    ended,
    grown_to,
    hertzloop,
    start,
    wait_for,
)
from tests.hertzloop.lanes import Pair
from tests.hertzloop.scenes import aluminium_3mm

FEEDBACK = ["controller.law=velocity_feedback", "controller.kappa=0.1", "run.accuracy=0.1"]


def feedback(*settings: str) -> Setup:
    return aluminium_3mm(*FEEDBACK, "run.duration_s=0.0025", *settings)


@pytest.mark.full
@pytest.mark.parametrize("lane", [True, False])
def test_with_time_to_spare_it_is_the_run_in_lock_step(lane, tmp_path):
    """A step every 20 ms, and 21 steps from a sample to its force."""
    scene = feedback("controller.latency_us=20", "run.duration_s=0.00006")
    pair = Pair(scene, shared_memory=lane, pace=0.00005).run()
    assert pair.fault == pair.controller_fault == ""
    assert pair.stats.wall_s >= 1.17  # the last of 60 steps begins then
    assert pair.stats.shared_memory == ("JOINED" if lane else "")
    told = pacing_of(pair.recorded(tmp_path / "paced.mcap"))
    assert told.clock.slack_us == pytest.approx(420_000.0)
    assert told.clock.answers_in_time == 1.0
    found = pair.samples()
    assert found.pop("truth.held_steps")
    assert found == {
        name: digest
        for name, digest in Pair(scene, shared_memory=False).run().samples().items()
        if name != "truth.held_steps"
    }


@pytest.mark.parametrize("lane", [True, False])
def test_late_forces_repeat_to_the_bit(lane, tmp_path):
    """Two threads of one process cannot answer 2500 times within 1 us each; how often they are late
    depends on the machine."""
    scene = feedback()
    pair = Pair(scene, shared_memory=lane, pace=1.0).run()
    first = pair.recorded(tmp_path / "paced.mcap")
    assert not first.problems
    found = pacing_of(first)
    held = first.truth.arrays["held_steps"]
    assert found.late_forces == np.count_nonzero(held) > 0
    rows = np.split(held > 0, np.flatnonzero(np.diff(held > 0)) + 1)
    assert found.longest_sequence == max(len(row) for row in rows if row[0])
    assert found.clock.answers == first.daq.samples - 1  # but the one in lock-step
    repeat = repeated_run(first)
    again = Pair(scene, shared_memory=not lane, repeat=repeat).run()
    assert again.fault == again.controller_fault == ""
    assert first_difference(first, again.recorded(tmp_path / "again.mcap")) is None
    # Without the late forces it is another run.
    other = replace(repeat, held_steps=np.zeros_like(held))
    assert "this is not the same run" in Pair(scene, repeat=other).run().fault


def test_a_row_of_late_forces_is_counted(tmp_path):
    """A controller that stops for 0.1 s at a pace that leaves 2.1 ms."""
    scene = feedback("controller.latency_us=20", "run.duration_s=0.0025")
    pair = Pair(scene, pace=0.01)
    work, slept = pair.controller.work, threading.Event()

    def pause(timeout_s: float) -> None:
        if pair.controller.samples > 100 and not slept.is_set():
            slept.set()
            time.sleep(0.1)
        work(timeout_s)

    pair.controller.work = pause  # type: ignore[method-assign]
    first = pair.run().recorded(tmp_path / "paced.mcap")
    assert slept.is_set()
    found = pacing_of(first)
    assert found.longest_sequence > 500
    assert found.clock.response_us["max"] > 90_000


def test_a_silent_controller_is_named(monkeypatch):
    pair = Pair(feedback("run.duration_s=0.02"), 2.0, pace=0.01)
    work = ControllerNode.work

    def stop(node: ControllerNode, timeout_s: float) -> None:
        if node.samples > 100:
            wait_for(lambda: pair.fault)
        work(node, timeout_s)

    monkeypatch.setattr(ControllerNode, "work", stop)
    assert "plant waited 2 s for the force for step" in pair.run().fault


@pytest.mark.full
def test_processes_repeat_what_a_pause_of_the_controller_did(tmp_path):
    """Over zenoh, as a user runs it, with a controller that was stopped for 0.1 s."""
    paced, again = tmp_path / "paced.mcap", tmp_path / "again.mcap"
    words = [*as_options(FEEDBACK), "--set", "run.duration_s=0.03", "--realtime", "off"]
    run = start("run", "aluminium-3mm", *words, "--pace", "0.01", "--out", str(paced))
    controller = child_of(run, "controller")
    wait_for(grown_to(paced, 30_000))
    controller.send_signal(signal.SIGSTOP)
    time.sleep(0.1)
    controller.send_signal(signal.SIGCONT)
    ended(run)
    hertzloop("run", "--repeat", str(paced), "--out", str(again))
    a, b = read(paced), read(again)
    assert first_difference(a, b) is None
    assert b.metadata["repeats"] == a.metadata["run_id"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--pace", "1e-8"], "use a pace of"),
        (
            ["--pace", "1", "--max-exchange-steps", "3"],
            "max_exchange_steps = 3: cannot be combined with pace = 1",
        ),
        (["--pace", "1", "--verify"], "verify = True: cannot be combined with pace = 1"),
        (
            ["--pace", "1", "--transport", "compiled"],
            "pace = 1.0: not available with transport = 'compiled'",
        ),
        (["--repeat", "no.mcap", "--seed", "3"], "--repeat: the recording fixes scene and seed"),
        (["--repeat", "no.mcap"], "cannot read no.mcap"),
    ],
)
def test_what_does_not_go_together(words, said):
    refused(said, "run", *words)


def test_classes_of_response_times():
    ends = class_ends_ns(clock.CLASSES, clock.CLASSES_AN_OCTAVE)
    starts = np.concatenate([[0], ends[:-1]])
    for ns in [*range(200), *(int(1.07**i) for i in range(80, 400))]:
        at = clock.class_of(ns)
        assert starts[at] <= ns < ends[at]
    assert np.max((ends - starts)[64:] / starts[64:]) <= 1 / 32
