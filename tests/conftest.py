"""Imported before any test module."""

# Decides how many threads the linear algebra has. It has to come before NumPy, which reads it
# once: with more, the last bits of a sum depend on its length.
import hertzloop  # noqa: F401, I001
import fcntl
import gc
import importlib.util
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import settings

from hertzloop.__main__ import collect_rarely
from hertzloop.scene import loading
from tests import elastic_scenes

# Before a command line is imported, whose modules take the function by its name.
elastic_scenes.pytest_configure()

# The first call of a kernel may compile it: no example has to meet a time.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")


collect_rarely()

# A shell's background job ignores Ctrl-C, and so do the processes that tests start and interrupt.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Packages of the extra `all-tests`, one for each of its lines that tests import.
_ALL_TESTS = (
    "control", "cosmic_ray", "cryptography", "distributed", "fmpy", "grpc_tools", "gymnasium",
    "h5py", "hatchling", "mkdocs", "nbclient", "pymoo", "pythonfmu",
    "sdypy", "skfem", "sksundae",
)  # fmt: skip


def _names_files(config: pytest.Config) -> bool:
    """Whether the command line names files or tests: then all of these run, in this process."""
    return config.args_source != pytest.Config.ArgsSource.TESTPATHS


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that choose the tier and the order."""
    parser.addoption("--all", action="store_true", help="run every test, not the default tier only")
    parser.addoption("--rest", action="store_true", help="run what the default tier leaves out")
    parser.addoption("--order", type=int, metavar="SEED", help="run the files in random order")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse `--all` and `--rest` where a package is missing: its tests would be skipped."""
    if config.getoption("--all") or config.getoption("--rest"):
        missing = [name for name in _ALL_TESTS if not importlib.util.find_spec(name)]
        if missing:
            raise pytest.UsageError(
                f"this tier needs {', '.join(missing)}. Run: pip install -e '.[all-tests]'"
            )


# What many tests run, in two shares that take about the same time.
_COMPILE = (
    """
ensure_compiled(load(DEFAULT, ["contact.plasticity=none"]))
""",
    """
ensure_compiled(load(DEFAULT, ["run.plate_model=infinite", "run.duration_s=0.0015"]))
""",
)
_IMPORTS = """
from hertzloop.__main__ import collect_rarely
from hertzloop.warmup import ensure_compiled
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import load

collect_rarely()
"""


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile on two cores before any process of tests starts: each of these would compile the
    same for itself."""
    config = session.config
    if hasattr(config, "workerinput") or _names_files(config) or config.option.collectonly:
        return
    compiling = [subprocess.Popen([sys.executable, "-c", _IMPORTS + share]) for share in _COMPILE]
    for process in compiling:
        process.wait()  # of what fails here, the tests say why


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the tests of the tier that was asked for, or all tests of files that are named. The
    slowest files come first, so that none of them runs alone at the end; `--order` shuffles all.
    """
    slow = ("test_page_commands.py", "test_same_bits.py", "test_checks.py")
    slow += ("hertzloop", "studies", "benchmarks")
    order = {name: place for place, name in enumerate(slow)}
    items.sort(
        key=lambda item: min(
            order.get(name, len(slow)) for name in item.path.relative_to(config.rootpath).parts
        )
    )
    seed = config.getoption("--order")
    if seed is not None:
        files = sorted({item.path for item in items})
        random.Random(seed).shuffle(files)
        place_of = {path: place for place, path in enumerate(files)}
        items.sort(key=lambda item: place_of[item.path])
    if config.getoption("--all") or _names_files(config):
        return
    rest = config.getoption("--rest")
    chosen = [item for item in items if bool(item.get_closest_marker("full")) == rest]
    kept = set(chosen)
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = chosen


def pytest_collection_finish() -> None:
    """Leave modules and tests out of the collections of garbage that pytest ends with."""
    gc.freeze()


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process of tests more than there are cores, since many tests wait; for some files, whose
    names were given, none but this."""
    return 0 if _names_files(config) else len(os.sched_getaffinity(0)) + 1


@contextmanager
def _alone(name: str) -> Iterator[None]:
    """One process of tests at a time."""
    from hertzloop.common.jit.folder import cache_folder

    with (cache_folder() / name).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture
def shipped_scenes(monkeypatch):
    """The shipped scenes as they are, not the elastic copies of most tests."""
    monkeypatch.setattr(loading, "shipped_text", elastic_scenes.as_shipped)


@pytest.fixture(scope="session")
def warm_kernels():
    """Compiled kernels, for tests whose processes must not spend their time on compiling."""
    from hertzloop.scene.setup import load
    from hertzloop.warmup import ensure_compiled

    with _alone(".tests"):
        models = ("modal", "infinite")
        ensure_compiled(*(load(loading.DEFAULT, [f"run.plate_model={one}"]) for one in models))


@pytest.fixture(scope="session")
def pool():
    """What studies run their cases in: this process."""
    from hertzloop.studies.cases.pool import local_pool

    with local_pool(1) as found:
        yield found
