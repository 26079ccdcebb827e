"""Simulate many cases of a scene on the cores at hand."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from multiprocessing import get_context, parent_process
from typing import Any

from hertzloop.loop.signals import interrupts_held_back
from hertzloop.results.cases import UNSTABLE, CaseFigures, Span, figures_of_case
from hertzloop.scenes.scene import Scene, SceneError, parse, to_toml, vary

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


def not_run(rows: Rows) -> Rows:
    """Rows of cases that could not be run; one that is unstable was, though it has no figures."""
    return [row for row in rows if row["status"] and not row["status"].startswith(UNSTABLE)]


@dataclass
class Tally:
    """How many cases were asked for, and the rows of those that could not be run."""

    cases: int = 0
    not_run: Rows = field(default_factory=list)

    def of(self, pool: Pool) -> Pool:
        """The same pool, counted."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            for rows in pool(toml, span, chunks):
                self.cases += len(rows)
                self.not_run += not_run(rows)
                yield rows

        return results


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
def _starting(count: int) -> Iterator[None]:
    """Say what a system lacks that starts no workers. Raises SweepFailed."""
    try:
        yield
    except OSError as error:
        raise SweepFailed(
            f"{count} workers cannot be started: {error.strerror} (they need some room in "
            "/dev/shm; --workers 1 needs none)"
        ) from error


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """Processes that run chunks: a function of scene (TOML), span and chunks that yields their
    rows as they come. Raises SweepFailed when a process dies, or none can be started."""
    count = workers or local_cores()
    if count == 1:
        yield lambda toml, span, chunks: (run_chunk(toml, span, chunk) for chunk in chunks)
        return
    # Spawned, not forked: the caller may have threads.
    with _starting(count):
        pool = ProcessPoolExecutor(count, get_context("spawn"), _end_with_parent)

    def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        with _starting(count), interrupts_held_back(), _without_main():
            futures = [pool.submit(run_chunk, toml, span, chunk) for chunk in chunks]
        return (future.result() for future in as_completed(futures))

    try:
        yield results
    except BrokenProcessPool as error:
        raise SweepFailed("a worker process died") from error
    finally:
        # Waited for: a thread of it that is left to the end of the interpreter may find its pipe
        # closed there, and the last that is said would be an OSError.
        pool.shutdown(wait=True, cancel_futures=True)


def evaluate(pool: Pool, scene: Scene, span: Span, cases: list[dict[str, Any]]) -> Rows:
    """Rows of all cases, in their order."""
    chunks = chunked(list(enumerate(cases)))
    rows = [row for some in pool(to_toml(scene), span, chunks) for row in some]
    return sorted(rows, key=lambda row: int(row["case"]))
