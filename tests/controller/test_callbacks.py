"""Laws as Python in compiled code: Ctrl-C while one runs, and a file that is given up in time."""

import gc
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest

from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.loop.simulate import simulate
from hertzloop.scene.setup import Setup, load


def scene_with(folder: Path, line: str, duration_s: float) -> Setup:
    law = folder / "mine.py"
    law.write_text(f"def command(p, s, samples, i):\n    {line}\n    return float(str(0.0))\n")
    return load("aluminium-3mm", [f"controller.law={law}", f"run.duration_s={duration_s}"])


def test_what_a_law_lets_pass_is_raised_behind_the_loop(tmp_path):
    scene = scene_with(tmp_path, "if i == 500: raise KeyboardInterrupt", 0.002)
    for _ in range(2):  # what is kept of the law between runs keeps nothing of this
        with pytest.raises(KeyboardInterrupt):
            simulate(scene)
    simulate(scene_with(tmp_path, "if i == 5000: raise KeyboardInterrupt", 0.002))


@pytest.mark.parametrize("after_ms", [2.0, 3.37, 6.8])
def test_ctrl_c_is_never_lost(after_ms, tmp_path):
    """Also where it comes between two samples: Python hears of it at the start of the next call,
    before anything there can catch it."""
    line = f"if i == 500: __import__('signal').setitimer(0, {1e-3 * after_ms})"
    scene = scene_with(tmp_path, line, 0.1)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    gc.disable()  # what is raised in a callback of the collector, as Hypothesis has one, is lost
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate(scene)
    finally:
        gc.enable()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("late_s", [-1e-4, 0.0])
def test_at_the_last_moment_it_is_over_or_overdue_once(late_s):
    """Whichever comes first, what follows is not interrupted any more."""
    patience_s, interrupted = 0.003, 0
    for _ in range(50):
        with suppress(LawTimeout), given_up_in_time(patience_s):
            until = time.perf_counter() + patience_s + late_s
            while time.perf_counter() < until:
                pass
        try:
            for _ in range(1000):
                pass
        except LawTimeout:
            interrupted += 1
    assert interrupted == 0
