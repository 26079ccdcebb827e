"""The real-time profile: what is set where it is permitted, and what is said where it is not. Every
test works in a child, whose class goes with it."""

import pytest

from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT


def child(text: str) -> str:
    """What Python prints on this text, with the profile at hand."""
    first = "import os\nfrom hertzloop.processes.realtime import RealtimeProfile\n"
    return python("-c", first + text, cwd=ROOT).stdout.strip()


@pytest.fixture(scope="session")
def permitted():
    """Skips where a real-time class is not."""
    text = """
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    print('yes')
except PermissionError:
    pass
"""
    if child(text) != "yes":
        pytest.skip("this user may not use SCHED_FIFO")


SHOW = """
kind = {os.SCHED_FIFO: 'FIFO', os.SCHED_OTHER: 'OTHER'}[os.sched_getscheduler(0)]
print(kind, os.sched_getparam(0).sched_priority)
"""


AUTO = f"""
os.sched_getaffinity = lambda _: {{0, 1}}
p = RealtimeProfile('auto', 'plant'){SHOW}print(p.line)
"""
REFUSED = """
def refuse(*_):
    raise PermissionError
os.sched_setscheduler = refuse
print(RealtimeProfile('on', 'plant').line)
"""
FOUR_CORES = """
taken = []
os.sched_getaffinity = lambda _: {0, 1, 2, 3}
os.sched_setaffinity = lambda _, cores: taken.append(cores)
os.sched_setscheduler = lambda *_: None
for role in ('plant', 'controller', 'recorder'):
    RealtimeProfile('auto', role)
print(taken)
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (AUTO, ["OTHER 0\noff, because the loops would take all 2 cores"]),
        (REFUSED, ["no SCHED_FIFO (allow it with rtprio in", "CAP_SYS_NICE"]),
        (FOUR_CORES, ["[[0, 1], [0, 1], [2, 3]]"]),
    ],
    ids=["a core for others", "not permitted", "more cores than loops"],
)
def test_what_is_set_and_said(text, words):
    said = child(text)
    assert all(word in said for word in words), said


@pytest.mark.usefixtures("permitted")
def test_the_loop_is_in_the_class_and_leaves_it():
    text = f"""
import gc
p = RealtimeProfile('on', 'plant'){SHOW}
with p.loop():
    print(gc.isenabled()){SHOW.replace(chr(10), chr(10) + "    ")}
print(gc.isenabled()){SHOW}
"""
    assert child(text).split("\n") == ["FIFO 51", "False", "FIFO 50", "True", "OTHER 0"]
