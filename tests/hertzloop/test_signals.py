"""Signals that end a process are counted, one by one."""

import os
import signal
import time

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
