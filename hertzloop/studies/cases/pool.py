"""Run cases on the cores of this machine: in this process, and in workers that it starts.

A worker takes two seconds to start. This process runs a thousand cases in that time. So it
begins at once, starts workers when the remaining work is worth it, and gives them only what they
are about to begin. It runs the rest itself.

What can fail, and where that is handled:

- A case that cannot be run has a row with its reason (`evaluate.py`). The others go on.
- A worker that dies, or that cannot be started, ends the study with `WorkersLost`. A journal keeps
  the finished cases (`journal.py`).
- A law that is not shipped may crash its process, so only workers run it, unless there is one
  process in all.
- Workers end when this process ends, however it ends (`workers.py`).
"""

import os
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from hertzloop.controller.loading.registry import shipped
from hertzloop.results.spans import Span
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.evaluate import (
    Numbered,
    Pool,
    run_cases,
    run_chunk,
    scene_of,
)
from hertzloop.studies.cases.rows import Rows
from hertzloop.studies.cases.workers import Workers, WorkersLost

_LOOK_S = 0.1  # of work here, before what is left is estimated
# Of work left for this process alone: twice what the start of another takes, in which this one
# goes on. With less, little time is gained for much work of the processor.
_WORTH_S = 4.0


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
        WorkersLost: a worker died, or none can be started.
    """
    pool = _WorkerPool(workers or local_cores())
    try:
        yield pool.results
    except BrokenProcessPool as error:
        raise WorkersLost(_why_lost(pool.own_laws)) from error
    finally:
        pool.dismiss()


class _WorkerPool:
    """This process and its workers, which stay for all calls of a study.

    Attributes:
        own_laws: Laws of the cases so far that are not shipped.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._workers: dict[int, Workers] = {}  # by their number
        self.own_laws: set[str] = set()

    def results(self, toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        if self._count == 1:
            return (run_chunk(toml, span, chunk) for chunk in chunks)
        setup = scene_of(toml)
        own_laws = _own_laws(setup, chunks)
        if own_laws:
            # A law that crashes its process must not end this one.
            self.own_laws |= own_laws
            return self._of(self._count).results(toml, span, deque(chunks))
        return self._with_this_process(setup, span, chunks)

    def _with_this_process(
        self, setup: Setup, span: Span, chunks: list[Numbered]
    ) -> Iterator[Rows]:
        """Yield the rows of chunks, some of which run in this process."""
        left = deque(_two_first(chunks))
        # Of processor time, as the start of another process: on a busy machine both take longer.
        began, first_s, ran = time.process_time(), 0.0, 0
        while left:
            rows = run_cases(setup, span, left.popleft())
            yield rows
            ran += len(rows)
            worked_s = time.process_time() - began
            first_s = first_s or worked_s  # which loads what all need
            if left and (self._workers or worked_s - first_s > _LOOK_S):
                a_case_s = (worked_s - first_s) / (ran - 1) if ran > 1 else worked_s
                if self._workers or a_case_s * sum(map(len, left)) > _WORTH_S:
                    others = self._of(self._count - 1)
                    yield from others.results(to_toml(setup.scene), span, left, setup)

    def _of(self, workers: int) -> Workers:
        if workers not in self._workers:
            self._workers[workers] = Workers(workers)
        return self._workers[workers]

    def dismiss(self) -> None:
        for others in self._workers.values():
            others.dismiss()


def _two_first(chunks: list[Numbered]) -> list[Numbered]:
    """Return the same chunks with the first two cases alone, which tell how long a case takes."""
    first = chunks[0] if chunks else []
    return [some for some in ([*first[:1]], [*first[1:2]], [*first[2:]], *chunks[1:]) if some]


def _own_laws(setup: Setup, chunks: list[Numbered]) -> set[str]:
    """Return the laws of cases that are not shipped."""
    usual = setup.scene.controller.law
    named = {values.get("controller.law", usual) for chunk in chunks for _, values in chunk}
    return named - set(shipped())


def _why_lost(own_laws: set[str]) -> str:
    """Return what a dead worker may have died of, in a sentence."""
    if not own_laws:
        return "a worker process died"
    law, *others = sorted(own_laws)
    several = f" (or {', '.join(others)})" if others else ""
    return (
        f"a worker process died in a case of the law {law}{several}. If it dies again, the law "
        "ends its process: see it with 'hertzloop run' in this scene"
    )
