"""Processes in terminals of their own, and the launcher's own end: every wait is bounded,
signals work at any moment, the right one is blamed, and nothing stays behind."""

import os
import re
import resource
import signal
import subprocess
import time
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from hertzloop.bus.streams import PLANT, RECORDER, ROLES
from hertzloop.recordings.reader import read
from tests.hertzloop.commands import (
    EVENTUALLY_S,
    LONG,
    WELL_UNDER_WAY,
    Bus,
    child_of,
    ended,
    grown_to,
    killed_at_the_end,
    leftovers,
    start,
    wait_for,
)


@pytest.fixture
def recording(tmp_path):
    return tmp_path / "run.mcap"


@contextmanager
def terminals(
    recording: Path,
    *words: str,
    timeout_s: float = EVENTUALLY_S,
    wait_s: float = EVENTUALLY_S,
    roles: Container[str] = ROLES,
) -> Iterator[dict[str, subprocess.Popen]]:
    """Plant, controller and recorder as three people would start them."""
    bus, own = Bus(f"terminals-{os.getpid()}"), {RECORDER: ["--out", str(recording)], PLANT: words}
    started = {
        role: bus.start(role, *own.get(role, ()), "--timeout", str(timeout_s), wait_s=wait_s)
        for role in reversed(ROLES)
        if role in roles
    }
    with killed_at_the_end(started.values()):
        yield started


TOLD = "the plant ended the run: interrupted at step"
MISSED = "recorder (left the run|or an observer accepted no message for 20 s)"


@pytest.mark.full
@pytest.mark.parametrize(
    ("victim", "sent", "timeout_s", "said"),
    [
        # By itself, or told by the controller, which sends to the recorder, too.
        (
            "recorder",
            signal.SIGSTOP,
            5.0,
            {
                "plant": (1, "recorder or an observer accepted no message for 5 s"),
                "controller": (1, ""),
            },
        ),
        # Much was sent to it, and it has not closed its file. As a rule that is heard at once, at
        # the latest when the patience with a message to it is over: see bus/zenoh_config.py.
        ("recorder", signal.SIGKILL, 20.0, {"plant": (1, MISSED), "controller": (1, MISSED)}),
        (
            "plant",
            signal.SIGINT,
            EVENTUALLY_S,
            {"plant": (130, "interrupted"), "controller": (1, TOLD), "recorder": (1, "")},
        ),
    ],
)
def test_all_are_told(recording, victim, sent, timeout_s, said):
    with terminals(recording, *LONG, timeout_s=timeout_s) as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles[victim].send_signal(sent)
        for role, (code, words) in said.items():
            assert re.search(words, ended(roles[role], code)), role


@pytest.mark.full
def test_a_plant_that_waits_for_a_frozen_recorder_hears_signals(recording):
    """The patience with the recorder is an hour here: what ends the wait is the signal."""
    with terminals(recording, *LONG, timeout_s=3600.0) as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles["recorder"].send_signal(signal.SIGSTOP)
        plant = psutil.Process(roles["plant"].pid)
        wait_for(lambda: plant.cpu_percent(0.5) < 2, 60)  # it is inside a call that waits
        roles["plant"].send_signal(signal.SIGTERM)
        ended(roles["plant"], 130, "interrupted")


@pytest.mark.full
def test_a_second_interrupt_leaves_no_process(recording):
    run = start("run", *LONG, "--out", str(recording))
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    child_of(run, "plant").send_signal(signal.SIGSTOP)  # it cannot end in order
    run.send_signal(signal.SIGINT)
    time.sleep(0.5)
    run.send_signal(signal.SIGINT)
    ended(run, 130)
    assert not leftovers(recording)


def test_an_interrupt_while_its_processes_start_ends_the_run(recording):
    run = start("run", *LONG, "--out", str(recording))
    child_of(run, "plant")
    run.send_signal(signal.SIGINT)
    ended(run, 130, "interrupted")
    assert not leftovers(recording)


@pytest.mark.full
def test_full_disk(recording):
    """The recorder may write 3 MB and no more; the kernel refuses the rest."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    run = start("run", *LONG, "--out", str(recording), preexec_fn=limit)
    ended(run, 1, f"cannot write the recording {recording}")
    assert not leftovers(recording)
    assert read(recording).problems


@pytest.mark.full
def test_controller_never_started(recording):
    with terminals(recording, wait_s=5.0, roles=[PLANT, RECORDER]) as roles:
        for process in roles.values():
            assert re.search("waited 5 s for controller .* not there", ended(process, 1))
    assert not recording.exists()  # nothing was to be recorded
