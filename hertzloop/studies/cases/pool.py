"""Run cases on the cores of this machine: in this process, and in workers that it starts.

A worker takes one or two seconds to start. This process runs a thousand cases in that time. So it
begins at once, starts workers when the remaining work is worth it, and gives them only what they
are about to begin. It runs the rest itself.

What can fail, and where that is handled:

- A case that cannot be run has a row with its reason (`evaluate.py`). The others go on.
- A worker that dies, or that cannot be started, ends the study with `SweepFailed`. A journal keeps
  the finished cases (`journal.py`).
- A law that is not shipped may crash its process, so only workers run it, unless there is one
  process in all.
- Workers end when this process ends, however it ends.

loky 3.7 was tried instead of `concurrent.futures`. It waits for ever for the rest of an answer
whose worker has died, and during Ctrl-C for a worker that hangs. Its workers survive a killed
parent.
"""

import gc
import os
import sys
import threading
import time
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

from hertzloop.controller.loading.registry import shipped
from hertzloop.processes.signals import deferred
from hertzloop.results.cases import Span
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.evaluate import Numbered, Pool, Rows, run_cases, run_chunk, scene_of

_RARELY = 100_000, 50, 50  # Python's own thresholds take 8 % of the time of cases
_LOOK_S = 0.1  # of work here, before what is left is estimated
_ASK_S = 0.1  # between two looks for an interrupt, and for a worker that has ended
_WORTH_S = 1.5  # of work left for this process alone: about what the start of another takes


class SweepFailed(RuntimeError):
    """A worker process was lost, or none could be started. Commands keep the finished cases in a
    journal."""

    exit_status = 1


def local_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """Yield a function of scene (TOML), span and chunks that yields their rows as they come.

    Args:
        workers: Number of processes, this one included; None: one for each core. A law that is not
            shipped runs in this many workers beside this process, unless the number is 1.

    Raises:
        SweepFailed: a worker died, or none can be started.
    """
    count = workers or local_cores()
    pool = _WorkerPool(count)
    try:
        yield pool.results
    except BrokenProcessPool as error:
        raise SweepFailed("a worker process died") from error
    finally:
        pool.dismiss()


class _WorkerPool:
    """This process and its workers, which stay for all calls of a study."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._workers: dict[int, _Workers] = {}  # by their number

    def results(self, toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        if self.count == 1:
            return (run_chunk(toml, span, chunk) for chunk in chunks)
        setup = scene_of(toml)
        if not _all_shipped(setup, chunks):
            # A law that crashes its process must not end this one.
            return self._of(self.count).results(toml, span, deque(chunks))
        return self._with_this_process(setup, span, chunks)

    def _with_this_process(
        self, setup: Setup, span: Span, chunks: list[Numbered]
    ) -> Iterator[Rows]:
        """Yield the rows of chunks, some of which run in this process."""
        left = deque(_two_first(chunks))
        # Of processor time, as the start of another process: on a busy machine both take longer.
        began, first_s, ran = time.process_time(), 0.0, 0
        while left:
            rows = list(run_cases(setup, span, left.popleft()))
            yield rows
            ran += len(rows)
            worked_s = time.process_time() - began
            first_s = first_s or worked_s  # which loads what all need
            if left and (self._workers or worked_s - first_s > _LOOK_S):
                a_case_s = (worked_s - first_s) / (ran - 1) if ran > 1 else worked_s
                if self._workers or a_case_s * sum(map(len, left)) > _WORTH_S:
                    others = self._of(self.count - 1)
                    yield from others.results(to_toml(setup.scene), span, left, setup)

    def _of(self, workers: int) -> "_Workers":
        if workers not in self._workers:
            self._workers[workers] = _Workers(workers)
        return self._workers[workers]

    def dismiss(self) -> None:
        for others in self._workers.values():
            others.dismiss()


class _Workers:
    """Worker processes. Raises SweepFailed if none can be started."""

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
                yield list(run_cases(own, span, left.pop()))
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


def _two_first(chunks: list[Numbered]) -> list[Numbered]:
    """Return the same chunks with the first two cases alone, which tell how long a case takes."""
    first = chunks[0] if chunks else []
    return [some for some in ([*first[:1]], [*first[1:2]], [*first[2:]], *chunks[1:]) if some]


def _all_shipped(setup: Setup, chunks: list[Numbered]) -> bool:
    usual = setup.law_reference
    named = {values.get("controller.law", usual) for chunk in chunks for _, values in chunk}
    return named <= set(shipped())


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
    """Turn an error at the start of workers into SweepFailed, with a remedy."""
    try:
        yield
    except OSError as error:
        raise SweepFailed(
            f"workers cannot be started: {error.strerror} (they need some room in /dev/shm; "
            "--workers 1 needs none)"
        ) from error
