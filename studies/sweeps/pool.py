"""Cases on the cores at hand: this process and others that it starts when there is work for them.

A process takes a second or two until it can run a case, in which this one runs a thousand. So this
one begins at once, starts the others where what is left is worth it, and takes back from them what
they have not begun.
"""

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process

from controller.door.registry import shipped
from hertzloop.loop.signals import interrupts_held_back
from hertzloop.results.cases import Span
from hertzloop.scenes.scene import Scene, to_toml
from studies.sweeps.evaluate import Numbered, Pool, Rows, run_cases, run_chunk, scene_of

_LOOK_S = 0.1  # of work here, before what is left is estimated
_WORTH_S = 1.5  # of work left for this process alone: about what the start of another takes


class SweepFailed(RuntimeError):
    """The cases were not all run; what was finished is kept."""


def local_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """As many processes as `workers` says, this one among them: a function of scene (TOML), span
    and chunks that yields their rows as they come. Raises SweepFailed when a process dies, or none
    can be started."""
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
        self._pools: dict[int, ProcessPoolExecutor] = {}  # by how many they are

    def results(self, toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        """Rows of the chunks as they come."""
        if self.count == 1:
            return (run_chunk(toml, span, chunk) for chunk in chunks)
        scene = scene_of(toml)
        if not _all_shipped(scene, chunks):
            # A law that crashes its process must not end the sweep's.
            return _finished(self._sent(self.count, toml, span, chunks))
        return self._with_own_hands(scene, span, chunks)

    def _with_own_hands(self, scene: Scene, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        """The same, some of them run here."""
        left, sent = deque(_two_first(chunks)), dict[Future[Rows], Numbered]()
        began, first_s, ran = time.perf_counter(), 0.0, 0
        while left:
            rows = list(run_cases(scene, span, left.popleft()))
            yield rows
            ran += len(rows)
            worked_s = time.perf_counter() - began
            first_s = first_s or worked_s  # which loads what all need
            if left and (self._pools or worked_s > _LOOK_S):
                a_case_s = (worked_s - first_s) / (ran - 1) if ran > 1 else worked_s
                if self._pools or a_case_s * sum(map(len, left)) > _WORTH_S:
                    sent = self._sent(self.count - 1, to_toml(scene), span, list(left))
                    left.clear()
        while sent:
            mine = next((future for future in reversed(sent) if future.cancel()), None)
            if mine is None:
                break
            yield list(run_cases(scene, span, sent.pop(mine)))
            for future in [future for future in sent if future.done()]:
                del sent[future]
                yield future.result()
        yield from _finished(sent)

    def _sent(
        self, workers: int, toml: str, span: Span, chunks: list[Numbered]
    ) -> dict[Future[Rows], Numbered]:
        """Chunks given to processes. Raises SweepFailed where none can be started."""
        with _starting():
            # Before interrupts are held back: multiprocessing lets them through again when it
            # starts what tracks its semaphores.
            if workers not in self._pools:
                # Spawned, not forked: the caller may have threads.
                pool = ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent)
                self._pools[workers] = pool
        pool = self._pools[workers]
        with _starting(), interrupts_held_back(), _without_main():
            return {pool.submit(run_chunk, toml, span, chunk): chunk for chunk in chunks}

    def dismiss(self) -> None:
        """Let the workers go."""
        for pool in self._pools.values():
            # Waited for: a thread of it that is left to the end of the interpreter may find its
            # pipe closed there, and the last that is said would be an OSError.
            pool.shutdown(wait=True, cancel_futures=True)


def _two_first(chunks: list[Numbered]) -> list[Numbered]:
    """The same, the first two cases each by itself: they tell what a case takes."""
    first = chunks[0] if chunks else []
    return [some for some in ([*first[:1]], [*first[1:2]], [*first[2:]], *chunks[1:]) if some]


def _finished(sent: dict[Future[Rows], Numbered]) -> Iterator[Rows]:
    return (future.result() for future in as_completed(sent))


def _all_shipped(scene: Scene, chunks: list[Numbered]) -> bool:
    """Whether all laws of some cases come with hertzloop."""
    usual = scene.controller.law
    named = {values.get("controller.law", usual) for chunk in chunks for _, values in chunk}
    return named <= set(shipped())


def _end_with_parent() -> None:
    """Let a worker end when its parent is killed; it would wait for work for ever."""
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
