"""Ctrl-C, SIGTERM and SIGHUP: raised, held back, counted, and left alone where they are ignored."""

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from hertzloop.processes.signals import deferred, ending_signals, install_handlers, received
from tests.hertzloop.commands import finish, next_line, start, wait_for


@pytest.fixture
def handlers():
    """The command line's handlers for the time of a test."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    # A caller such as nohup may ignore SIGHUP, which the handlers would respect.
    before = {number: signal.signal(number, signal.SIG_DFL) for number in numbers}
    install_handlers()
    yield
    received.clear()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_raises_but_not_while_it_is_deferred(number):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    steps: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        hold_back(number, steps.append)
    assert steps == ["held"]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def hold_back(number: signal.Signals, steps: Callable[[str], None]) -> None:
    with deferred():
        os.kill(os.getpid(), number)
        time.sleep(0.1)
        steps("held")


@pytest.mark.usefixtures("handlers")
def test_a_signal_is_deferred_where_another_thread_takes_it():
    over, steps = threading.Event(), list[str]()
    other = threading.Thread(target=over.wait)
    other.start()
    with pytest.raises(KeyboardInterrupt):
        hold_back(signal.SIGINT, steps.append)
    over.set()
    other.join()
    assert steps == ["held"]


@pytest.mark.usefixtures("handlers")
def test_one_that_a_call_from_c_has_lost_is_raised_before_the_next_work():
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)  # and nobody heeds it
    with pytest.raises(KeyboardInterrupt), ending_signals(lambda _: None):
        pass


def test_ending_signals_are_counted_in_order():
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


@pytest.mark.usefixtures("handlers")
def test_a_signal_that_is_ignored_stays_so():
    """As under nohup: a run goes on where its terminal closes."""
    counted: list[int] = []
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ending_signals(counted.append):
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGTERM)
        assert counted == [1]  # all that came is counted when the context has ended
        install_handlers()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.full
def test_a_run_that_compiles_ends_in_one_sentence(tmp_path):
    """Nothing goes on compiling for it."""
    cache = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    run = start("run", "--out", str(tmp_path / "a.mcap"), env=cache)
    assert next_line(run, run.stderr).startswith("Compiling the model")
    folder = cache["NUMBA_CACHE_DIR"]
    wait_for(lambda: any(Path(folder).rglob("*.nbi")))  # it has begun
    assert len(processes_with(folder)) == 1
    run.send_signal(signal.SIGINT)
    assert finish(run) == (130, "interrupted")
    assert not (tmp_path / "a.mcap").exists()
    wait_for(lambda: not processes_with(folder), 5.0)


def processes_with(value: str) -> list[str]:
    """Ids of the processes that have this text in their environment."""
    found = list[str]()
    for file in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):  # it has ended, or is another user's
            if value.encode() in file.read_bytes():
                found.append(file.parent.name)
    return found
