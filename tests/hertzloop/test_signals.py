"""Signals that end a process: counted one by one, and heard while the command imports."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import pytest

from hertzloop.processes.signals import ending_signals


def test_ending_signals_are_counted_in_order() -> None:
    counted: list[int] = []
    before = signal.getsignal(signal.SIGTERM)
    with ending_signals(counted.append):
        for number in (1, 2, 3):
            os.kill(os.getpid(), signal.SIGTERM)
            deadline = time.monotonic() + 10.0
            while len(counted) < number and time.monotonic() < deadline:
                time.sleep(0.001)
            assert counted == list(range(1, number + 1))
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize("ignored", [signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_that_is_ignored_stays_so(ignored: signal.Signals) -> None:
    """As under nohup, or in a script's background: a run goes on where its terminal closes."""
    counted: list[int] = []
    before = signal.signal(ignored, signal.SIG_IGN)
    try:
        with ending_signals(counted.append):
            signal.raise_signal(ignored)
            signal.raise_signal(signal.SIGTERM)
        assert counted == [1]  # all that came is counted when the context has ended
        assert signal.getsignal(ignored) == signal.SIG_IGN
    finally:
        signal.signal(ignored, before)


_INTERRUPTED_IMPORT = """
import signal, sys

class Finder:
    def find_spec(self, name, path, target=None):
        if name in {modules!r}:
            signal.raise_signal(signal.{signal})

sys.argv[0] = {name!r}
sys.meta_path.insert(0, Finder())
import hertzloop.__main__
sys.argv[1:] = ["law", "--help"]
hertzloop.__main__.main()
"""
_FIRST, _LATE = "hertzloop.processes", "hertzloop.cli.app"


def interrupted_as_it_imports(
    name: str,
    number: int = signal.SIGINT,
    modules: Sequence[str] = (_FIRST,),
    before: Any = signal.SIG_DFL,
) -> tuple[int, str]:
    script = _INTERRUPTED_IMPORT.format(
        name=name, signal=signal.Signals(number).name, modules=modules
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        preexec_fn=lambda: signal.signal(number, before),
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("name", "module"),
    [("SIGINT", _FIRST), ("SIGTERM", _FIRST), ("SIGTERM", _LATE), ("SIGHUP", _FIRST),
     ("SIGQUIT", _LATE)],
)  # fmt: skip
def test_the_command_ends_quietly_in_its_imports(name: str, module: str) -> None:
    number = signal.Signals[name]
    found = interrupted_as_it_imports("/usr/bin/hertzloop", number, [module])
    assert found == (130, "interrupted\n")


def test_what_nohup_ignores_stays_ignored() -> None:
    found = interrupted_as_it_imports(
        "/usr/bin/hertzloop", signal.SIGHUP, [_FIRST, _LATE], signal.SIG_IGN
    )
    assert found == (0, "")


def test_another_program_that_imports_the_command_keeps_its_handler() -> None:
    code, said = interrupted_as_it_imports("/home/me/program.py")
    assert code == -signal.SIGINT
    assert said.endswith("KeyboardInterrupt\n")
