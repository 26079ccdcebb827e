"""Runs tests in forks of one process that has loaded what takes long to load, and none of ours.

A job is a line of JSON, [arguments of pytest, file for what is printed, processor time that the
process may take, s]; answers are the process's id at once, then its exit code and the processor
time that it and its children took, s.
"""

import importlib
import json
import os
import resource
import sys
from contextlib import suppress

_SLOW = (
    "pytest", "hypothesis", "numpy", "numba", "scipy.optimize", "pydantic",
    "google.protobuf.message", "mcap.writer", "zenoh", "psutil", "typer", "rich.console",
)  # fmt: skip


def main(mark: str) -> None:
    """`mark`: a name that the environment of all that tests start has."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as hertzloop does, before NumPy is here
    for name in _SLOW:
        with suppress(ImportError):
            importlib.import_module(name)
    for line in sys.stdin:
        arguments, log, most_s = json.loads(line)
        child = os.fork()
        if child == 0:
            os.environ[mark] = os.getcwd()
            _run(arguments, log, most_s)
        print(child, flush=True)
        _, status, used = os.wait4(child, 0)
        took = used.ru_utime + used.ru_stime
        print(os.waitstatus_to_exitcode(status), round(took, 2), flush=True)


def _run(arguments: list[str], log: str, most_s: int) -> None:
    """In a session of its own, in which nobody reads the jobs. Does not return."""
    os.setsid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for to in (1, 2):
        os.dup2(os.open(log, os.O_WRONLY | os.O_APPEND), to)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s))
    import pytest

    sys.exit(pytest.main(arguments))


if __name__ == "__main__":
    main(sys.argv[1])
