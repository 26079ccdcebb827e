"""Ctrl-C that comes where nothing can be raised: in a call from C, as compiling has some."""

import subprocess
import sys
from pathlib import Path

# A shell's background job ignores SIGINT from the start.
CALL = """
import ctypes, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
call = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
"""
HEARD = """
from hertzloop.processes.signals import hear_lost_interrupts, interrupt
signal.signal(signal.SIGINT, interrupt)
lost = hear_lost_interrupts()
"""


def ended(script: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-c", CALL + script], capture_output=True, text=True, timeout=60
    )
    return done.returncode, done.stdout, done.stderr


def test_it_is_heard_a_moment_later() -> None:
    script = """
for _ in range(3):
    try:
        call()
        time.sleep(30)
    except KeyboardInterrupt:
        print(lost.is_set())
"""
    assert ended(HEARD + script) == (0, "True\n" * 3, "")


def test_the_next_one_is_heard_that_comes_while_it_is_sent_again() -> None:
    """As on a busy machine: the main thread has not left Python's hook when the moment is over."""
    script = """
import threading
start = threading.Timer.start
def start_slowly(timer):
    threading.Timer.start = start
    start(timer)
    time.sleep(0.5)
threading.Timer.start = start_slowly
try:
    call()
    time.sleep(30)
except KeyboardInterrupt:
    print("heard", threading.Timer.start is start)
"""
    assert ended(HEARD + script) == (0, "heard True\n", "")


def test_it_is_heard_after_a_class_has_named_its_attributes() -> None:
    """As while modules are imported; Python 3.11 makes a RuntimeError of what comes out of that."""
    script = """
class Attribute:
    def __set_name__(self, owner, name):
        signal.raise_signal(signal.SIGINT)
        print(name)
try:
    class Whole:
        first = Attribute()
    time.sleep(30)
except KeyboardInterrupt:
    print("heard")
"""
    assert ended(HEARD + script) == (0, "first\nheard\n", "")


def test_it_is_held_back_where_another_thread_takes_it() -> None:
    script = """
import os, threading
from hertzloop.processes.signals import interrupts_held_back
threading.Thread(target=time.sleep, args=(5,), daemon=True).start()
steps = []
try:
    with interrupts_held_back():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
        steps.append("held")
    steps.append("forgotten")
except KeyboardInterrupt:
    steps.append("heard")
print(*steps)
"""
    assert ended(HEARD + script) == (0, "held heard\n", "")


def test_many_that_cannot_be_raised_are_sent_as_one() -> None:
    """A second one would come out while the first is explained, and leave no words."""
    script = """
def calls():
    for _ in range(20):
        call()
try:
    calls()
    time.sleep(30)
except KeyboardInterrupt:
    time.sleep(0.5)
    print("heard")
"""
    assert ended(HEARD + script) == (0, "heard\n", "")


def test_what_fails_for_it_is_no_error_of_the_command() -> None:
    script = """
from hertzloop import __main__
from hertzloop.cli import app
def fails(commands):
    call()
    raise RuntimeError("no compiled object yet for <Library>")
app.main = fails
__main__.main()
"""
    assert ended(script) == (130, "", "interrupted\n")


def test_a_law_is_not_refused_for_it(tmp_path: Path) -> None:
    script = f"""
from hertzloop.controller.loading import compiled
from hertzloop.controller.loading.registry import find
from hertzloop.law import About
def lost(self, name):
    raise RuntimeError("no compiled object yet for <Library>")
compiled.Entries._compiled, whole = lost, compiled.Entries._compiled
path = "{tmp_path}/mine.py"
open(path, "w").write("def command(p, s, samples, i):\\n    return 0.0\\n# " + str(time.time_ns()))
law = find(path)
try:
    law.bind(law.keys(), About())
except KeyboardInterrupt:
    print("interrupted")
compiled.Entries._compiled = whole
print(law.bind(law.keys(), About()).trouble)
"""
    assert ended(script) == (0, "interrupted\n\n", "")
