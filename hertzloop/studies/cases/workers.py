"""Processes that run cases: they end with this one, and a lost one is noticed.

loky 3.7 was tried instead of `concurrent.futures`. It waits for ever for the rest of an answer
whose worker has died, and during Ctrl-C for a worker that hangs. Its workers survive a killed
parent.
"""

import gc
import os
import sys
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import parent_process, resource_tracker
from multiprocessing.connection import wait as ready
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.queues import SimpleQueue
from typing import Any

from hertzloop.processes.signals import deferred
from hertzloop.results.spans import Span
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Numbered, run_cases, run_chunk
from hertzloop.studies.cases.rows import Rows

_RARELY = 100_000, 50, 50  # Python's own thresholds take 8 % of the time of cases
_ASK_S = 0.1  # between two looks for an interrupt, and for a worker that has ended


class WorkersLost(RuntimeError):
    """A worker process was lost, or none could be started."""

    exit_status = 1


class Workers:
    """Worker processes. Raises WorkersLost if none can be started."""

    def __init__(self, count: int) -> None:
        self._started = _SpawnedProcesses()
        with _starting():
            _start_tracker()
            self._pool = ProcessPoolExecutor(count, self._started, _end_with_parent)
        self._ahead = 2 * count + 1  # one for each at work and one for each that is done with it

    def results(
        self, toml: str, span: Span, left: deque[Numbered], own: Setup | None = None
    ) -> Iterator[Rows]:
        """Yield the rows of the remaining chunks as they come.

        With `own`, the scene of the chunks, this process runs chunks that no worker has.

        A future is never cancelled: when a worker dies, Python 3.11 fails at a cancelled future,
        and a wait for the others never ends. Interrupts are deferred while a future is asked: an
        interrupt there may leave the lock of the future taken, and the pool's thread waits for it
        for ever.
        """
        given = set[Future[Rows]]()
        while left or given:
            with _starting(), deferred(), _without_main():
                while left and len(given) < self._ahead:
                    given.add(self._pool.submit(run_chunk, toml, span, left.popleft()))
            wait_s = _ASK_S
            if own and left:
                yield run_cases(own, span, left.pop())
                wait_s = 0.0
            with deferred():
                wait(given, wait_s, return_when=FIRST_COMPLETED)
                done = {future for future in given if future.done()}
                if not done and self._lost():
                    raise BrokenProcessPool
            given -= done
            for future in done:
                with deferred():
                    rows = future.result()
                yield rows

    def _lost(self) -> bool:
        """Whether a worker has ended. Python's pool does not notice this while a worker writes an
        answer: it waits for the rest of it."""
        started = [process for process in self._started.processes if process.pid is not None]
        return bool(ready([process.sentinel for process in started], 0.0))

    def dismiss(self) -> None:
        # Interrupts are deferred, since Python 3.11 takes a thread for ended when the wait for it
        # is interrupted. A thread of the pool that lives until the interpreter ends may find its
        # pipe closed, and print an OSError.
        with deferred():
            for process in self._started.processes:
                if process.pid is not None:  # None: the process could not be started
                    process.kill()
            # Without writers, a thread that waits for the rest of an answer ends.
            self._started.answers._writer.close()  # type: ignore[attr-defined]
            self._pool.shutdown(wait=True)


class _SpawnedProcesses(SpawnContext):
    """Context that spawns processes, since the caller may have threads, and that keeps a list of
    them and the queue of their answers."""

    answers: SimpleQueue[Any]

    def __init__(self) -> None:
        super().__init__()
        self.processes: list[SpawnProcess] = []

    def SimpleQueue(self) -> SimpleQueue[Any]:
        self.answers = super().SimpleQueue()
        return self.answers

    def Process(self, *args: Any, **named: Any) -> SpawnProcess:  # type: ignore[override]
        self.processes.append(SpawnProcess(*args, **named))
        return self.processes[-1]


def _start_tracker() -> None:
    """Start the process that removes the workers' semaphores if this one is killed. A terminal that
    closes signals it, too, and must not end it first."""
    with deferred():
        resource_tracker.ensure_running()


def _end_with_parent() -> None:
    """Let a worker end when its parent is killed; it would wait for work for ever. It looks for
    cycles of garbage as rarely as the program does."""
    gc.set_threshold(*_RARELY)
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _without_main() -> Iterator[None]:
    """Start workers that do not import the caller's script: they need nothing from it, and a script
    without a guarded main would start workers of its own."""
    main = sys.modules["__main__"]
    hidden = {name: getattr(main, name) for name in ("__spec__", "__file__") if hasattr(main, name)}
    main.__spec__ = None
    main.__dict__.pop("__file__", None)
    try:
        yield
    finally:
        for name, value in hidden.items():
            setattr(main, name, value)


@contextmanager
def _starting() -> Iterator[None]:
    """Turn an error at the start of workers into WorkersLost, with a remedy."""
    try:
        yield
    except OSError as error:
        raise WorkersLost(
            f"workers cannot be started: {error.strerror} (they need some room in /dev/shm; "
            "--workers 1 needs none)"
        ) from error
