"""When a law counts as one that never returns."""

import pytest

from hertzloop.loop import stuck_law


@pytest.fixture
def clock(monkeypatch):
    """The thread's time in s."""
    now = [1000.0]
    monkeypatch.setattr(stuck_law.time, "monotonic", lambda: now[0])
    return now


def looked_at(clock: list[float], progress: list[int], pauses_s: list[float]) -> list[bool]:
    """Whether it is stuck after each of these pauses, while it has come as far as `progress`."""
    run = stuck_law._Run("mine.py", iter(progress).__next__, print, "samples", patience_s=20.0)
    found = []
    for pause_s in pauses_s:
        clock[0] += pause_s
        found.append(run.stuck())
    return found


def test_one_that_has_not_begun_may_compile(clock):
    assert not any(looked_at(clock, [0] * 9 + [1], [5.0] * 10))


def test_a_process_that_was_stopped_did_not_work(clock):
    """The pause is no time in which the law could have answered."""
    assert looked_at(clock, [3, 3, 4, 4], [5.0, 3600.0, 5.0, 3600.0]) == [False] * 4
