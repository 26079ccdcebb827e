"""Simulate many cases of a scene on the cores at hand."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, fields
from multiprocessing import get_context, parent_process
from typing import Any

from hertzloop.cases import CaseFigures, Span, figures_of_case
from hertzloop.scene import Scene, SceneError, parse, to_toml, vary

_CHUNK = 16  # cases that travel together: some 40 ms of work

Numbered = list[tuple[int, dict[str, Any]]]
Rows = list[dict[str, Any]]
Pool = Callable[[str, Span, list[Numbered]], Iterator[Rows]]


class SweepFailed(RuntimeError):
    """The cases were not all run; what was finished is kept."""


def run_chunk(scene_toml: str, span: Span, numbered: list[tuple[int, dict[str, Any]]]) -> list[Any]:
    """Simulate some cases, in whatever process; a row each."""
    scene = parse(scene_toml)
    return [run_case(scene, span, number, values) for number, values in numbered]


def run_case(scene: Scene, span: Span, number: int, values: dict[str, Any]) -> dict[str, Any]:
    """One case: its number, the varied keys, the figures, and `status`, empty if all is well."""
    row: dict[str, Any] = {"case": number, **values}
    try:
        return row | asdict(figures_of_case(vary(scene, values), span)) | {"status": ""}
    except Exception as error:  # one case must not end the others
        status = str(error) if isinstance(error, SceneError) else f"failed: {error!r}"
        return row | dict.fromkeys(f.name for f in fields(CaseFigures)) | {"status": status}


def chunked(numbered: Numbered) -> list[Numbered]:
    """Cases in the portions that travel together."""
    return [numbered[i : i + _CHUNK] for i in range(0, len(numbered), _CHUNK)]


def local_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _end_with_parent() -> None:
    """Let a worker end when its parent is killed; it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _without_interrupt() -> Iterator[None]:
    """Hold Ctrl-C back; processes started meanwhile never get it, it is for their parent."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """Processes that run chunks: a function of scene (TOML), span and chunks that yields their
    rows as they come. Raises SweepFailed when a process dies."""
    count = workers or local_cores()
    if count == 1:
        yield lambda toml, span, chunks: (run_chunk(toml, span, chunk) for chunk in chunks)
        return
    # Spawned, not forked: the caller may have threads.
    pool = ProcessPoolExecutor(count, get_context("spawn"), _end_with_parent)

    def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        with _without_interrupt():
            futures = [pool.submit(run_chunk, toml, span, chunk) for chunk in chunks]
        return (future.result() for future in as_completed(futures))

    try:
        yield results
    except BrokenProcessPool as error:
        raise SweepFailed("a worker process died") from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def evaluate(pool: Pool, scene: Scene, span: Span, cases: list[dict[str, Any]]) -> Rows:
    """Rows of all cases, in their order."""
    chunks = chunked(list(enumerate(cases)))
    rows = [row for some in pool(to_toml(scene), span, chunks) for row in some]
    return sorted(rows, key=lambda row: int(row["case"]))
