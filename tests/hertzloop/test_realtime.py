"""The real-time profile: what is set where it is permitted, what is said where it is not, and the
watchdog that gives the cores back. Every test works in a child, whose class goes with it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import realtime
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import load
from hertzloop.views.run_json import run_as_json
from tests.hertzloop.processes import hertzloop

ROOT = Path(__file__).parents[2]


def child(text: str, fails: int = 0) -> str:
    """What Python prints on this text, with the profile at hand."""
    first = "import os, time\nfrom hertzloop.processes.realtime import RealtimeProfile, Wanted\n"
    done = subprocess.run(
        [sys.executable, "-c", first + text], capture_output=True, text=True, cwd=ROOT, timeout=120
    )
    assert done.returncode in (0, fails), done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="session")
def permitted() -> None:
    """Skips where a real-time class is not."""
    if (
        child("os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)); print('yes')", 1)
        != "yes"
    ):
        pytest.skip("this user may not use SCHED_FIFO")


SHOW = """
kind = {os.SCHED_FIFO: 'FIFO', os.SCHED_OTHER: 'OTHER'}[os.sched_getscheduler(0)]
print(kind, os.sched_getparam(0).sched_priority)
"""


def test_off_sets_nothing() -> None:
    assert child(f"p = RealtimeProfile(Wanted.OFF, 'plant'){SHOW}print(p.line())") == "OTHER 0\noff"


def test_auto_leaves_a_core_to_others() -> None:
    text = "os.sched_getaffinity = lambda _: {0, 1}\np = RealtimeProfile(Wanted.AUTO, 'plant')"
    said = child(text + SHOW + "print(p.line())")
    assert said == "OTHER 0\noff, because the loops would take all 2 cores"


@pytest.mark.parametrize(
    ("most", "said"),
    [
        ("950000", "SCHED_FIFO for 95% of a second (sched_rt_runtime_us = 950000)"),
        ("-1", "SCHED_FIFO"),
    ],
)
def test_what_the_system_keeps_of_a_second(
    most: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {"runtime": most, "period": "1000000"}
    monkeypatch.setattr(Path, "read_text", lambda path: texts[path.name.split("_")[2]])
    assert realtime._loops_class() == said


def test_what_is_refused_is_said_with_the_remedy() -> None:
    text = """
def refuse(*_):
    raise PermissionError
os.sched_setscheduler = refuse
os.geteuid = lambda: 1000
import resource
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
print(RealtimeProfile(Wanted.ON, 'plant').line())
"""
    said = child(text)
    assert "not granted: SCHED_FIFO (allow it with rtprio in" in said
    assert "CAP_SYS_NICE" in said
    assert "locked memory (allow it with memlock in" in said


def test_more_cores_than_loops_are_shared_out() -> None:
    text = """
taken = []
os.sched_getaffinity = lambda _: {0, 1, 2, 3}
os.sched_setaffinity = lambda _, cores: taken.append(cores)
os.sched_setscheduler = lambda *_: None
for role in ('plant', 'controller', 'recorder'):
    RealtimeProfile(Wanted.AUTO, role)
print(taken)
"""
    assert child(text) == "[[0, 1], [0, 1], [2, 3]]"


@pytest.mark.usefixtures("permitted")
def test_the_loop_is_in_the_class_and_leaves_it() -> None:
    text = f"""
import gc
p = RealtimeProfile(Wanted.ON, 'plant'){SHOW}
with p.loop(lambda: 0):
    print(gc.isenabled()){SHOW.replace(chr(10), chr(10) + "    ")}
print(gc.isenabled()){SHOW}
"""
    assert child(text).split("\n") == [
        "FIFO 51", "False", "FIFO 50", "True", "OTHER 0"
    ]  # fmt: skip


@pytest.mark.usefixtures("permitted")
def test_a_loop_that_spins_without_progress_gives_the_class_up() -> None:
    text = """
p = RealtimeProfile(Wanted.ON, 'plant')
with p.loop(lambda: 0):
    until = time.monotonic() + 20
    while os.sched_getscheduler(0) == os.SCHED_FIFO and time.monotonic() < until:
        pass
print(os.sched_getscheduler(0) == os.SCHED_OTHER, p.line())
"""
    said = child(text)
    assert said.startswith("True ")
    assert "withdrawn: the loop spun without progress" in said


@pytest.mark.usefixtures("permitted")
def test_a_loop_that_is_slow_for_a_while_keeps_the_class() -> None:
    """More than half a second of processor time for a step, twice."""
    text = """
p, steps = RealtimeProfile(Wanted.ON, 'plant'), [0]
with p.loop(lambda: steps[0]):
    for _ in range(2):
        until = time.process_time() + 0.6
        while time.process_time() < until:
            pass
        steps[0] += 1
        time.sleep(0.6)
    print(os.sched_getscheduler(0) == os.SCHED_FIFO, 'withdrawn' in p.line())
"""
    assert child(text) == "True False"


def test_a_run_says_what_was_granted(tmp_path: Path) -> None:
    scene = load("aluminium-3mm", ["run.duration_s=0.0015"])
    report = run_as_json(run_and_assess(scene, tmp_path / "a.mcap", RunOptions(realtime="off")))
    assert report["realtime"] == "off"
    assert "auto" in hertzloop("run", "--help").stdout
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
