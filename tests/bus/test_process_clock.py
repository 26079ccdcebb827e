"""The clock of a process leaves out the time in which the process did not run."""

import time

import pytest

from hertzloop.bus.process_clock import ProcessClock


def test_a_pause_does_not_count(monkeypatch):
    at = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: at[0])
    clock = ProcessClock()
    began_s = clock.now()
    for step_s in (0.5, 0.9, 30.0, 0.5):
        at[0] += step_s
        clock.now()
    assert clock.now() - began_s == pytest.approx(0.5 + 0.9 + 0.2 + 0.5)
    assert clock.paused_s(within_s=1.0) == 30.0
    assert clock.paused_s(within_s=0.4) == 0.0
    assert clock.since(101.0) == pytest.approx(31.9 - 1.0 - 30.0)
    assert clock.since(131.5) == pytest.approx(0.4)
