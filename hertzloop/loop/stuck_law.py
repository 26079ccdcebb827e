"""A law that never returns blocks its process for good: a thread notices and ends it."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup

PATIENCE_S = 20.0
_LOOKS = 4  # in that time


@dataclass(eq=False)
class _Run:
    """One that is watched, with what was last seen of it, when, and how long it was the same."""

    law: str
    progress: Callable[[], int]
    on_stuck: Callable[[str], None]
    what: str
    patience_s: float
    seen: int = 0
    looked_s: float = field(default_factory=time.monotonic)
    same_s: float = 0.0

    def stuck(self) -> bool:
        """Whether it has come no further for too long; kernels may compile before its start. A look
        counts for no more than its share: a process that was stopped (Ctrl-Z) is not stuck."""
        now, looked_s = self.progress(), time.monotonic()
        self.same_s += min(looked_s - self.looked_s, self.patience_s / _LOOKS)
        self.looked_s = looked_s
        if now != self.seen or now == 0:
            self.seen, self.same_s = now, 0.0
        return self.same_s >= self.patience_s

    def end(self) -> None:
        """End the process."""
        sentence = (
            f"law {self.law}: no answer for {self.patience_s:g} s after {self.seen} {self.what} "
            "of the run. Check it for an endless loop."
        )
        self.on_stuck(sentence)
        print(f"error: {sentence}", file=sys.stderr, flush=True)
        os._exit(1)


# One thread for all runs of a process: one a case took a third of what the case took.
_runs: list[_Run] = []
_started = threading.Lock()
_thread = threading.Thread()


@contextmanager
def watching(
    setup: Setup,
    progress: Callable[[], int],
    on_stuck: Callable[[str], None] = lambda sentence: None,
    what: str = "samples",
    patience_s: float | None = None,
) -> Iterator[None]:
    """End this process with exit code 1 and a sentence when `progress` of a run stays the same for
    too long; `on_stuck` can save what there is first. Needs kernels that release the interpreter.

    Runs of shipped laws are not watched.
    """
    if setup.scene.controller.law_is_shipped:
        yield
        return
    law = loaded_law(setup).name
    run = _Run(law, progress, on_stuck, what, patience_s or PATIENCE_S)
    _runs.append(run)
    _ensure_watch()
    try:
        yield
    finally:
        _runs.remove(run)


def _ensure_watch() -> None:
    """Start the thread, unless there is one; after a fork there is none."""
    global _thread
    with _started:
        if not _thread.is_alive():
            _thread = threading.Thread(target=_watch, name="watchdog of laws", daemon=True)
            _thread.start()


def _watch() -> None:
    while True:
        time.sleep(min((run.patience_s for run in tuple(_runs)), default=PATIENCE_S) / _LOOKS)
        for run in tuple(_runs):
            if run.stuck() and run in _runs:
                run.end()
