"""Cases on the workers of a Dask cluster, in place of processes of this machine."""

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from hertzloop.results.spans import Span
from hertzloop.studies.cases.axis import DesignError
from hertzloop.studies.cases.evaluate import Numbered, Pool, run_chunk
from hertzloop.studies.cases.identity import code_version
from hertzloop.studies.cases.rows import Rows
from hertzloop.studies.cases.workers import WorkersLost

if TYPE_CHECKING:
    from distributed import Client

_WORKERLESS_S, _LOOK_S = 60.0, 5.0  # that a Dask cluster may be without workers; between two looks


@contextmanager
def dask_pool(address: str, on_wait: Callable[[str], None]) -> Iterator[Pool]:
    """Yield a function as `local_pool` does, which uses the workers of a Dask scheduler.

    Dask gives the work of a dead worker to others.

    Args:
        address: Address of the scheduler, for example tcp://host:8786.
        on_wait: Called with a sentence when the scheduler has no workers.

    Raises:
        DesignError: the address is none.
        WorkersLost: no scheduler answers, its workers have other versions, or the cluster is lost.
    """
    try:
        from distributed import CancelledError, Client, KilledWorker
        from distributed import as_completed as dask_completed
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise WorkersLost(
            "--dask needs the package distributed: pip install distributed"
        ) from error
    # Dask logs tracebacks; here an error is one sentence.
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # some loggers have their own level
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout="10s")
    except ValueError as error:
        raise DesignError(
            f"--dask = '{address}': {error}. Give the address of a scheduler, as tcp://host:8786."
        ) from error
    except (OSError, TimeoutError) as error:
        raise WorkersLost(f"no Dask scheduler answers at {address}: {error}") from error
    without = f"the Dask scheduler at {address} has no workers"
    waits = f"{without}; waiting {_WORKERLESS_S:g} s for one (dask worker {address})"
    done = threading.Event()

    def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        futures = client.map(
            lambda chunk: run_chunk(toml, span, chunk), chunks, pure=False, retries=2
        )

        def watch() -> None:
            """Cancel the work if there is no worker for a while: Dask waits for ever."""
            alone_s = 0.0
            while not done.wait(_LOOK_S):
                with suppress(Exception):  # a lost scheduler is reported below
                    alone_s = 0.0 if client.scheduler_info()["workers"] else alone_s + _LOOK_S
                    if alone_s == _LOOK_S:
                        on_wait(waits)
                    if alone_s >= _WORKERLESS_S:
                        client.cancel(futures)
                        return

        threading.Thread(target=watch, daemon=True).start()
        return (future.result() for future in dask_completed(futures))

    with client:
        if not client.scheduler_info()["workers"]:
            on_wait(waits)
        try:
            client.wait_for_workers(1, timeout=_WORKERLESS_S)
        except TimeoutError as error:
            raise WorkersLost(without) from error
        _check_versions(client)
        try:
            yield results
        except (CancelledError, CommClosedError, KilledWorker) as error:
            raise WorkersLost(f"the Dask cluster at {address} was lost") from error
        finally:
            done.set()


def _check_versions(client: "Client") -> None:
    """Refuse a cluster whose workers have other versions. Raises WorkersLost."""
    ours = code_version()
    for worker, theirs in client.run(code_version).items():
        if theirs != ours:
            raise WorkersLost(
                f"the worker {worker} has {theirs}, this process {ours}; install the same"
            )
