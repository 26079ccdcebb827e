"""Cases on the cores at hand: this process and others that it starts when there is work for them.

A process takes a second or two until it can run a case, in which this one runs a thousand. So this
one begins at once, starts the others where what is left is worth it, and gives them only what they
are about to begin; the rest stays within its own reach.

loky 3.7 was tried instead of `concurrent.futures`. It waits without end for the rest of an answer
whose worker has died, and during Ctrl-C for that of one that hangs. A worker that is at work when
its parent is killed runs on. The tests of this pool ask for the opposite.
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
from hertzloop.studies.sweeps.evaluate import Numbered, Pool, Rows, run_cases, run_chunk, scene_of

_RARELY = 100_000, 50, 50  # Python's own thresholds take 8 % of the time of cases
_LOOK_S = 0.1  # of work here, before what is left is estimated
_ASK_S = 0.1  # between two looks for an interrupt, and for a worker that has ended
_WORTH_S = 1.5  # of work left for this process alone: about what the start of another takes


class SweepFailed(RuntimeError):
    """Some cases could not be run. The finished cases are kept."""

    exit_status = 1


def local_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """As many processes as `workers` says, this one among them: a function of scene (TOML), span
    and chunks that yields their rows as they come. Where a law is not one that is shipped, this one
    waits for so many others instead, unless `workers` is 1. Raises SweepFailed when a process dies,
    or none can be started."""
    count = workers or local_cores()
    crew = _Crew(count)
    try:
        yield crew.results
    except BrokenProcessPool as error:
        raise SweepFailed("a worker process died") from error
    finally:
        crew.dismiss()


class _Crew:
    """This process and its workers, which stay from one search's generation to the next."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._others: dict[int, _Others] = {}  # by how many they are

    def results(self, toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        if self.count == 1:
            return (run_chunk(toml, span, chunk) for chunk in chunks)
        setup = scene_of(toml)
        if not _all_shipped(setup, chunks):
            # A law that crashes its process must not end the sweep's.
            return self._of(self.count).results(toml, span, deque(chunks))
        return self._with_own_hands(setup, span, chunks)

    def _with_own_hands(self, setup: Setup, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        """The same, some of them run here."""
        left = deque(_two_first(chunks))
        # Of processor time, as the start of another process: on a busy machine both take longer.
        began, first_s, ran = time.process_time(), 0.0, 0
        while left:
            rows = list(run_cases(setup, span, left.popleft()))
            yield rows
            ran += len(rows)
            worked_s = time.process_time() - began
            first_s = first_s or worked_s  # which loads what all need
            if left and (self._others or worked_s - first_s > _LOOK_S):
                a_case_s = (worked_s - first_s) / (ran - 1) if ran > 1 else worked_s
                if self._others or a_case_s * sum(map(len, left)) > _WORTH_S:
                    others = self._of(self.count - 1)
                    yield from others.results(to_toml(setup.scene), span, left, setup)

    def _of(self, workers: int) -> "_Others":
        if workers not in self._others:
            self._others[workers] = _Others(workers)
        return self._others[workers]

    def dismiss(self) -> None:
        for others in self._others.values():
            others.dismiss()


class _Others:
    """Worker processes. Raises SweepFailed where none can be started."""

    def __init__(self, count: int) -> None:
        self._started = _Started()
        with _starting():
            _start_tracker()
            self._pool = ProcessPoolExecutor(count, self._started, _end_with_parent)
        self._ahead = 2 * count + 1  # one for each at work and one for each that is done with it

    def results(
        self, toml: str, span: Span, left: deque[Numbered], own: Setup | None = None
    ) -> Iterator[Rows]:
        """Rows of the chunks that are left, as they come; with `own`, their scene, this process
        runs what the others have not been given.

        What is given is never cancelled: where a worker dies, Python 3.11 fails over a future that
        was, and those who wait for the others wait for ever. Interrupts are held back wherever a
        future is asked: one that is heard in there may leave its lock taken, for which the pool's
        thread waits for ever.
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
        """Whether a worker has ended. Python's pool does not notice where that was within an
        answer: it waits for the rest, which another could still write."""
        started = [process for process in self._started.processes if process.pid is not None]
        return bool(ready([process.sentinel for process in started], 0.0))

    def dismiss(self) -> None:
        # Held back, since Python 3.11 takes a thread for ended when it is interrupted in waiting
        # for it. Waited for: a thread of it that is left to the end of the interpreter may find its
        # pipe closed there, and the last that is said would be an OSError.
        with deferred():
            for process in self._started.processes:
                if process.pid is not None:  # of one that could not be started
                    process.kill()
            # Without writers, whoever waits for the rest of an answer hears that there is none.
            self._started.answers._writer.close()  # type: ignore[attr-defined]
            self._pool.shutdown(wait=True)


class _Started(SpawnContext):
    """Processes that are spawned, not forked, since the caller may have threads; they are kept, as
    is the way of their answers."""

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
    """The same, the first two cases each by itself: they tell what a case takes."""
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
    """Start workers that do not import the caller's script: they need nothing of it, and a script
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
    """Say what a system lacks that starts no workers. Raises SweepFailed."""
    try:
        yield
    except OSError as error:
        raise SweepFailed(
            f"workers cannot be started: {error.strerror} (they need some room in /dev/shm; "
            "--workers 1 needs none)"
        ) from error
