"""Run the cases of a sweep; what is finished survives a kill."""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hertzloop.studies.cases.dask_pool import dask_pool
from hertzloop.studies.cases.evaluate import chunked
from hertzloop.studies.cases.journal import Journal, JournalError
from hertzloop.studies.cases.pool import local_cores, local_pool
from hertzloop.studies.cases.rows import Rows, without_result
from hertzloop.studies.sweep.growth import with_growth
from hertzloop.studies.sweep.plan import SweepPlan
from hertzloop.studies.sweep.result import SweepResult
from hertzloop.studies.sweep.results_file import read_results, write_results


def sweep(
    plan: SweepPlan,
    out: Path | None = None,
    *,
    on_progress: Callable[[int], None] = lambda finished: None,
    on_wait: Callable[[str], None] = lambda sentence: None,
) -> SweepResult:
    """Run all cases of a sweep that an earlier start has not finished.

    Args:
        plan: The cases.
        out: File for the results (.parquet or .csv); None writes none. Finished cases of a sweep
            that was interrupted are in `journal_of(out)`.
        on_progress: Called with the number of finished cases.
        on_wait: Called with a sentence when the sweep waits for workers of Dask.

    Raises:
        WorkersLost: workers were lost. The finished cases are kept.
        JournalError: the journal belongs to another sweep, or is in use.
        OSError: a file cannot be written.
    """
    if out is None:
        return _run(plan, None, on_progress, on_wait)
    with Journal(journal_of(out), plan.identity) as journal:
        result = _run(plan, journal, on_progress, on_wait)
    write_results(out, result.rows, plan.identity)
    journal_of(out).unlink()
    return result


def _run(
    plan: SweepPlan,
    journal: Journal | None,
    on_progress: Callable[[int], None],
    on_wait: Callable[[str], None],
) -> SweepResult:
    """Run the cases that the journal lacks."""
    request, done = plan.request, {} if journal is None else journal.done
    cases = list(enumerate(plan.cases))
    missing = [(number, values) for number, values in cases if number not in done]
    chunks = chunked(missing)
    on_progress(len(done))
    started = time.perf_counter()
    if chunks:
        # Two at least: a law that is not shipped runs beside this process.
        count = min(request.workers or local_cores(), max(2, len(chunks)))
        address = request.dask
        with dask_pool(address, on_wait) if address else local_pool(count) as pool:
            for some in pool(plan.identity["scene_toml"], request.span, chunks):
                for row in some:
                    done[row["case"]] = row
                    if journal is not None:
                        journal.add(row)
                on_progress(len(done))
    wall_s = time.perf_counter() - started
    ran = len(missing) - len(without_result([done[number] for number, _ in missing]))
    rows: Rows = [done[number] for number, _ in cases]
    damaged = [] if journal is None else journal.damaged
    return SweepResult(with_growth(plan.setup, plan.design.keys, rows), ran, wall_s, damaged)


def finished(plan: SweepPlan, out: Path) -> SweepResult | None:
    """Return what `out` holds if it has the results of this very sweep, else None."""
    try:
        rows, header = read_results(out)
    except ValueError:
        return None
    if header != json.loads(json.dumps(plan.identity)):
        return None
    if journal_of(out).exists():  # of this sweep, which was killed at its end, or of another one
        with suppress(JournalError), Journal(journal_of(out), plan.identity):
            journal_of(out).unlink()
    return SweepResult([{"growth_per_s": None} | row for row in rows], 0, 0.0, [])


def journal_of(out: Path) -> Path:
    """Return where the finished cases of an unfinished sweep are."""
    return out.with_name(out.name + ".partial")
