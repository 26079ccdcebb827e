"""The real-time profile: what is set where it is permitted, what is said where it is not, and the
watchdog that gives the cores back. Every test works in a child, whose class goes with it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hertzloop.loop.run_options import RunOptions
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import load
from hertzloop.views.run_json import run_as_json
from tests.hertzloop.commands import hertzloop

ROOT = Path(__file__).parents[3]


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
    text = "os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)); print('yes')"
    if child(text, fails=1) != "yes":
        pytest.skip("this user may not use SCHED_FIFO")


SHOW = """
kind = {os.SCHED_FIFO: 'FIFO', os.SCHED_OTHER: 'OTHER'}[os.sched_getscheduler(0)]
print(kind, os.sched_getparam(0).sched_priority)
"""


AUTO = f"""
os.sched_getaffinity = lambda _: {{0, 1}}
p = RealtimeProfile(Wanted.AUTO, 'plant'){SHOW}print(p.line())
"""
REFUSED = """
def refuse(*_):
    raise PermissionError
os.sched_setscheduler = refuse
os.geteuid = lambda: 1000
import resource
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
print(RealtimeProfile(Wanted.ON, 'plant').line())
"""
FOUR_CORES = """
taken = []
os.sched_getaffinity = lambda _: {0, 1, 2, 3}
os.sched_setaffinity = lambda _, cores: taken.append(cores)
os.sched_setscheduler = lambda *_: None
for role in ('plant', 'controller', 'recorder'):
    RealtimeProfile(Wanted.AUTO, role)
print(taken)
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (AUTO, ["OTHER 0\noff, because the loops would take all 2 cores"]),
        (REFUSED, ["not granted: SCHED_FIFO (allow it with rtprio in", "CAP_SYS_NICE",
                   "locked memory (allow it with memlock in"]),
        (FOUR_CORES, ["[[0, 1], [0, 1], [2, 3]]"]),
    ],
    ids=["a core for others", "not permitted", "more cores than loops"],
)  # fmt: skip
def test_what_is_set_and_said(text: str, words: list[str]) -> None:
    said = child(text)
    assert all(word in said for word in words), said


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


def test_a_run_says_what_was_granted(tmp_path: Path) -> None:
    scene = load("aluminium-3mm", ["run.duration_s=0.0015"])
    report = run_as_json(run_and_assess(scene, tmp_path / "a.mcap", RunOptions(realtime="off")))
    assert report["realtime"] == "off"
    assert "auto" in hertzloop("run", "--help").stdout
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
