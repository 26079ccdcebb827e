"""Ctrl-C, and what else is to end more than a law, while one runs as Python in compiled code."""

import gc
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.scene.setup import Setup, load


class Ended(BaseException):
    """No Exception, as KeyboardInterrupt is none."""


def scene_with(folder: Path, line: str, duration_s: float) -> Setup:
    law = folder / "mine.py"
    law.write_text(f"def command(p, s, samples, i):\n    {line}\n    return float(str(0.0))\n")
    return load("aluminium-3mm", [f"controller.law={law}", f"run.duration_s={duration_s}"])


@pytest.fixture
def raised_in_the_law() -> Iterator[type[BaseException]]:
    np.ended = Ended  # type: ignore[attr-defined]
    yield Ended
    del np.ended  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", ["KeyboardInterrupt", "__import__('numpy').ended"])
def test_what_a_law_lets_pass_is_raised_behind_the_loop(
    kind: str, tmp_path: Path, raised_in_the_law: type[BaseException]
) -> None:
    scene = scene_with(tmp_path, f"if i == 500: raise {kind}", 0.002)
    for _ in range(2):  # what is kept of the law between runs keeps nothing of this
        with pytest.raises((KeyboardInterrupt, raised_in_the_law)):
            simulate(scene)
    simulate(scene_with(tmp_path, f"if i == 5000: raise {kind}", 0.002))


@pytest.mark.parametrize("after_ms", [2.0 + 0.137 * k for k in range(40)])
def test_ctrl_c_is_never_lost(after_ms: float, tmp_path: Path) -> None:
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
