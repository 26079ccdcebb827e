"""Imported before any test module."""

# Decides how many threads the linear algebra has. It has to come before NumPy, which reads it
# once: with more, the last bits of a sum depend on its length.
import hertzloop  # noqa: F401, I001
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import settings

# The first call of a kernel may compile it: no example has to meet a time.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process of tests more than there are cores, since many tests wait; for some files, whose
    names were given, none but this."""
    whole = config.args_source == pytest.Config.ArgsSource.TESTPATHS
    return len(os.sched_getaffinity(0)) + 1 if whole else 0


@contextmanager
def _alone(name: str) -> Iterator[None]:
    """One process of tests at a time."""
    from jit.cache import cache_folder

    with (cache_folder() / name).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def warm_kernels() -> None:
    """Compiled kernels, for tests whose processes must not spend their time on compiling."""
    from hertzloop.commands.warmup import ensure_compiled

    with _alone(".tests"):
        ensure_compiled(lambda: None)
