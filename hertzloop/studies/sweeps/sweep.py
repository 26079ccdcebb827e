"""Many cases of a scene, on the cores at hand or on many machines, that survive a kill."""

import hashlib
import json
import logging
import math
import os
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from hertzloop.common.atomic_files import atomic_write, whole_file
from hertzloop.common.jit.folder import code_digest
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find, resolve, shipped
from hertzloop.results.cases import CASE_METRICS, SHOWN, CaseState, Span
from hertzloop.scene.controller import law_constants
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml, toml_value
from hertzloop.studies.margin.margin import growth_of
from hertzloop.studies.sweeps.design import Design, keys_of, toml_text
from hertzloop.studies.sweeps.evaluate import (
    Numbered,
    Pool,
    Rows,
    chunked,
    not_run,
    older_state,
    run_chunk,
)
from hertzloop.studies.sweeps.journal import Journal
from hertzloop.studies.sweeps.pool import SweepFailed, local_cores, local_pool
from hertzloop.studies.worst.of_case import LATENCIES, worst_columns

_NOT_OF_LOOP = ("run.touch_phase", "run.seed", "run.duration_s")  # the linear loop is the same
_PACKAGES = ("hertzloop", "numpy", "numba")
_WORKERLESS_S, _LOOK_S = 60.0, 5.0  # that a Dask cluster may be without workers; between two looks


@dataclass(frozen=True)
class SweepResults:
    """How a sweep went: all rows in the order of the cases, how many were run just now, in what
    time, and which lines of an earlier journal were damaged, so that their cases ran again."""

    rows: list[dict[str, Any]]
    ran: int
    wall_s: float
    damaged: list[int]

    @property
    def not_run(self) -> list[dict[str, Any]]:
        """Rows of cases that could not be run; `status` says why."""
        return not_run(self.rows)

    @property
    def growing(self) -> list[float]:
        """Growth of the linear loop, 1/s, in each case that has metrics although its loop is
        unstable; nan where undecided."""
        return [
            row["growth_per_s"]
            for row in self.rows
            if row["state"] == CaseState.METRICS and row["growth_per_s"]
        ]

    @property
    def unstable(self) -> int:
        """Number of cases that were run but have no metrics, since the loop explodes."""
        return sum(row["state"] == CaseState.UNSTABLE for row in self.rows)


def code_version() -> str:
    """What decides the bits of a result: versions, and the digest of all compiled kernels."""
    return ", ".join([*(f"{p} {version(p)}" for p in _PACKAGES), f"kernels {code_digest()}"])


def laws_of(setup: Setup, design: Design) -> dict[str, dict[str, str]]:
    """What decides the forces of every law of a sweep, by what the scene or the axis calls it:
    name, digest, text, and a digest of the constants that it prepares for the scene."""
    named = [setup.law_reference]
    named += [str(v) for axis in design.axes if axis.key == "controller.law" for v in axis.values]
    found = {}
    for reference in named:
        law = find(resolve(reference))
        digest = law.digest
        if law.identity_note():  # no earlier results are of this very law
            digest += secrets.token_hex(8)
        constants = "" if law.name in shipped() else _constants_digest(setup, reference)
        found[reference] = {
            "name": law.name,
            "digest": digest,
            "source": law.source,
            "constants": constants,
        }
    return found


def _constants_digest(setup: Setup, law: str) -> str:
    """Digest of the constants that a law prepares, perhaps from files; empty if it refuses the
    scene, which its cases say."""
    try:
        found = law_constants(setup.vary({"controller.law": law}))
    except SceneError:
        return ""
    values = found.values() if isinstance(found, Mapping) else found
    digest = hashlib.sha256()
    for value in values:
        digest.update(np.asarray(value, float).tobytes())
    return digest.hexdigest()[:16]


def work_of(scenes: Sequence[Setup], laws: Iterable[str], design: Design) -> dict[str, Any]:
    """What decides the cases of a search or a chart, and what comes of them, as far as all share
    it: scenes, laws with their digests, versions. The arguments of each come on top."""
    return {
        "scenes": [to_toml(setup.scene) for setup in scenes],
        "laws": [laws_of((scenes[0]).vary({"controller.law": law}), design) for law in laws],
        "versions": code_version(),
    }


def check_laws(header: dict[str, Any]) -> None:
    """Raises SceneError if a law is not any more what a sweep's results were made with."""
    for reference, about in header.get("laws", {}).items():
        try:
            find(resolve(reference), about["digest"])
        except LawError as error:
            raise SceneError(f"the results cannot be verified: {error}") from error


def header_of(setup: Setup, design: Design, span: Span) -> dict[str, Any]:
    """What names a sweep, and goes with its results."""
    return {
        "scene_toml": to_toml(setup.scene),
        "design": asdict(design),
        "laws": laws_of(setup, design),
        "span": span,
        "versions": code_version(),
    }


def finished(setup: Setup, design: Design, span: Span, out: Path) -> SweepResults | None:
    """Return what `out` holds if it has the results of this very sweep, else None."""
    try:
        rows, header = read_results(out)
    except ValueError:
        return None
    if header != json.loads(json.dumps(header_of(setup, design, span))):
        return None
    journal_of(out).unlink(missing_ok=True)
    return SweepResults([{"growth_per_s": None} | row for row in rows], 0, 0.0, [])


def sweep(
    setup: Setup,
    design: Design,
    span: Span,
    out: Path,
    *,
    workers: int | None = None,
    dask: str | None = None,
    on_progress: Callable[[int], None] = lambda finished: None,
    on_wait: Callable[[str], None] = lambda sentence: None,
) -> SweepResults:
    """Run all cases that were not finished earlier, and write `out` (.parquet or .csv).

    Unfinished, its rows are in `journal_of(out)`. `on_wait` is told when the sweep waits for
    workers. Raises SweepFailed, JournalError, OSError.
    """
    cases = list(enumerate(design.cases()))
    header = header_of(setup, design, span)
    with Journal(journal_of(out), header) as journal:
        open_ = [(number, values) for number, values in cases if number not in journal.done]
        chunks = chunked(open_)
        on_progress(len(journal.done))
        started = time.perf_counter()
        if chunks:
            count = min(workers or local_cores(), len(chunks))
            with _dask_pool(dask, on_wait) if dask else local_pool(count) as pool:
                for rows in pool(header["scene_toml"], span, chunks):
                    for row in rows:
                        journal.add(row)
                    on_progress(len(journal.done))
        wall_s = time.perf_counter() - started
        ran = len(open_) - len(not_run([journal.done[number] for number, _ in open_]))
        rows = [journal.done[number] for number, _ in cases]
    rows = with_growth(setup, design.keys, rows)
    write_results(out, rows, header)
    journal_of(out).unlink()
    return SweepResults(rows, ran, wall_s, journal.damaged)


def with_growth(setup: Setup, keys: Sequence[str], rows: Rows) -> Rows:
    """Return rows with the column `growth_per_s`: growth of the linear loop in flight, 1/s; 0 if
    it is stable, nan if undecided, None without a linear loop."""
    known: dict[str, float | None] = {}
    without: dict[str, bool] = {}  # laws without a loop
    varied = [key for key in keys if key not in _NOT_OF_LOOP]

    def growth(row: dict[str, Any]) -> float | None:
        law = str(row.get("controller.law", setup.law_reference))
        if law not in without:
            without[law] = _has_no_loop(law)
        if without[law]:
            return None
        values = {key: row[key] for key in varied}
        name = repr(values)  # a value may be a list
        if name not in known:
            try:
                found = growth_of(setup.vary(values))
                undecided = found is not None and found.per_s is None
                known[name] = None if found is None else math.nan if undecided else found.per_s
            except SceneError:
                known[name] = None
            except Exception:  # whatever the analysis lacks, the cases are done
                known[name] = math.nan
        return known[name]

    return [row | {"growth_per_s": growth(row)} for row in rows]


def _has_no_loop(law_reference: str) -> bool:
    """Whether a law makes no linear loop in flight, whatever its constants."""
    try:
        law = find(law_reference)
    except LawError:
        return True
    return bool(law.not_linear) or law.senses == "contact_force"


def journal_of(out: Path) -> Path:
    """Where the finished cases of an unfinished sweep are."""
    return out.with_name(out.name + ".partial")


@contextmanager
def _dask_pool(address: str, on_wait: Callable[[str], None]) -> Iterator[Pool]:
    """As `local_pool`, of the workers of a Dask scheduler; it gives a dead worker's work to
    others."""
    try:
        from distributed import CancelledError, Client, KilledWorker
        from distributed import as_completed as dask_completed
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise SweepFailed(
            "--dask needs the package distributed: pip install distributed"
        ) from error
    # What it says of its own, with tracebacks, is said here in a sentence.
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # some have a level of their own
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise SweepFailed(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        without = f"the Dask scheduler at {address} has no workers"
        waits = f"{without}; waiting {_WORKERLESS_S:g} s for one (dask worker {address})"
        if not client.scheduler_info()["workers"]:
            on_wait(waits)
        try:
            client.wait_for_workers(1, timeout=_WORKERLESS_S)
        except TimeoutError as error:
            raise SweepFailed(without) from error
        ours = code_version()
        for worker, theirs in client.run(code_version).items():
            if theirs != ours:
                raise SweepFailed(
                    f"the worker {worker} has {theirs}, this process {ours}; install the same"
                )
        done = threading.Event()

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            futures = client.map(
                lambda chunk: run_chunk(toml, span, chunk), chunks, pure=False, retries=2
            )

            def watch() -> None:
                """Cancel the work where no worker has come for a while: Dask waits for ever."""
                alone_s = 0.0
                while not done.wait(_LOOK_S):
                    with suppress(Exception):  # a scheduler that is lost is said below
                        alone_s = 0.0 if client.scheduler_info()["workers"] else alone_s + _LOOK_S
                        if alone_s == _LOOK_S:
                            on_wait(waits)
                        if alone_s >= _WORKERLESS_S:
                            client.cancel(futures)
                            return

            threading.Thread(target=watch, daemon=True).start()
            return (future.result() for future in dask_completed(futures))

        try:
            yield results
        except (CancelledError, CommClosedError, KilledWorker) as error:
            raise SweepFailed(f"the Dask cluster at {address} was lost") from error
        finally:
            done.set()


def write_results(out: Path, rows: list[dict[str, Any]], header: dict[str, Any]) -> None:
    """Write a Parquet file with `header` in its metadata, or a CSV file and `header` beside it in
    NAME.csv.json. Raises NotWritten."""
    keys = keys_of(header["design"])
    alike = _one_type_a_column(rows, keys, out.suffix)
    table = pa.table({name: column_of([row[name] for row in alike]) for name in alike[0]})
    about = json.dumps(header, indent=2)
    with whole_file(out) as unfinished:
        if out.suffix == ".parquet":
            kept = {b"hertzloop": about.encode(), **(table.schema.metadata or {})}
            pyarrow.parquet.write_table(table.replace_schema_metadata(kept), unfinished)
        else:
            pyarrow.csv.write_csv(table, unfinished)
            atomic_write(_beside(out), about + "\n")


_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}


def column_of(values: list[Any]) -> pa.Array:
    """A column of a table. Numbers and texts are given as memory, since `pa.array` imports pandas
    if it is installed, which takes longer than a hundred cases."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return pa.nulls(len(values))
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is str:
        builder = pa.lib.StringBuilder()
        builder.append_values(values)
        return builder.finish()
    if kind not in _TYPES:
        return pa.array(values)
    known = np.array([value is not None for value in values])
    data = np.array([kind() if value is None else value for value in values])
    memory = [
        np.packbits(part, bitorder="little") if part.dtype == bool else part
        for part in (known, data)
    ]
    return pa.Array.from_buffers(_TYPES[kind], len(values), [pa.py_buffer(m) for m in memory])


def _beside(out: Path) -> Path:
    """Header of results in CSV."""
    return out.with_name(out.name + ".json")


def _one_type_a_column(
    rows: list[dict[str, Any]], keys: list[str], suffix: str
) -> list[dict[str, Any]]:
    """Rows with numbers of one type, and values as TOML text for keys that have values of several
    types, or lists in CSV."""
    for key in keys:
        if {type(row[key]) for row in rows} == {int, float}:
            rows = [row | {key: float(row[key])} for row in rows]
    text = [
        key
        for key in keys
        if len({type(row[key]) for row in rows}) > 1
        or (suffix != ".parquet" and isinstance(rows[0][key], list))
    ]
    if LATENCIES in rows[0] and suffix != ".parquet":
        text.append(LATENCIES)
    if not text:
        return rows
    return [
        row | {key: None if row[key] is None else toml_text(row[key]) for key in text}
        for row in rows
    ]


def read_results(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Rows and header of a sweep's results. Raises ValueError for another kind of file."""
    if path.suffix == ".partial":
        raise ValueError(f"{path}: is unfinished. Run the command that started it again.")
    if not os.path.isfile(path):
        raise ValueError(f"{path}: no such results. Give a file that a sweep wrote.")
    if path.suffix == ".csv" and not _beside(path).is_file():
        raise ValueError(f"{path}: the file {_beside(path).name} is missing beside it. Restore it.")
    if path.suffix not in (".parquet", ".csv"):
        raise ValueError(f"{path} holds no results of a sweep, which end in .parquet or .csv")
    try:
        if path.suffix == ".parquet":
            table = pyarrow.parquet.read_table(path)
            header = json.loads(table.schema.metadata[b"hertzloop"])
        else:
            table = pyarrow.csv.read_csv(path)
            header = json.loads(_beside(path).read_text(encoding="utf-8"))
        keys = keys_of(header["design"])
        searched = header["design"].get("worst")
        worst = worst_columns(searched) if searched else ()
        names = ["case", *keys, *CASE_METRICS, "status", "state", *worst, "growth_per_s"]
        if not {*CASE_METRICS} & {*table.column_names}:
            raise KeyError("column of metrics")
        # A version before may not have had a metric, but every case has its keys.
        later = {*CASE_METRICS} - {*table.column_names}
        columns = [name for name in names if name in table.column_names or name in keys]
        rows = [
            {**dict.fromkeys(later), **row, "state": row.get("state") or older_state(row["status"])}
            for row in table.select(columns).to_pylist()
        ]
        for name in ("scene_toml", "span", "versions"):
            header[name]
    except KeyError as error:
        raise ValueError(f"{path} holds no results of a sweep: it has no {error}") from error
    except (pa.ArrowException, ValueError, TypeError, OSError) as error:
        raise ValueError(f"{path} holds no results of a sweep: {error}") from error
    for key in [*keys, LATENCIES] if searched else keys:
        for row in rows:
            if isinstance(row[key], str):
                # pyrefly: ignore[bad-argument-type]
                row[key] = toml_value(row[key]) if row[key] else None
    return rows, header


def worst_row(rows: Rows, metric: str) -> dict[str, Any] | None:
    """The row with the worst value that the search of the worst latencies found; None without."""
    name = worst_columns(metric)[0]
    return max(known(rows, name), key=lambda row: row[name], default=None)


def counted(rows: Rows, column: str) -> dict[str, int]:
    """How many cases have each of the names in a column of `CaseMetrics`."""
    names = (name for row in rows for name in (row[column] or "").split(", ") if name)
    return dict(Counter(names).most_common())


def known(rows: Rows, metric: str) -> Rows:
    """The cases that have a metric."""
    return [row for row in rows if row[metric] is not None and row[metric] == row[metric]]


def extremes(rows: Rows, keys: list[str], metrics: Sequence[str] = SHOWN) -> list[list[str]]:
    """Where each metric is least and largest: its name, the least, its keys, the largest, its
    keys, in words."""
    found = []
    for metric in metrics:
        having = known(rows, metric)
        if not having:
            continue
        ends = [pick(having, key=lambda row: row[metric]) for pick in (min, max)]
        where = [
            ", ".join(f"{key.split('.')[-1]} {short(row[key])}" for key in keys) for row in ends
        ]
        least, most = (f"{row[metric]:z.2f}" for row in ends)
        found.append([metric, least, where[0], most, where[1]])
    return found


def short(value: Any) -> str:
    """A value of a key in four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
