"""Tests run on mutants in a copy of the sources: the sources themselves are never touched."""

import compileall
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path

import psutil

from jit.ownership import own
from tests.mutants.choosing import chosen

_NOT_COPIED = (".git", "__pycache__", ".*_cache", ".venv", "venv", ".hypothesis")
_MARK = "HERTZLOOP_MUTANTS"  # in the environment of all that a test starts, and its children


class Busy(Exception):
    """The copy is in use by another such command."""


class Copy:
    """A copy of the sources at `root`, and what is known of their tests.

    It has the same place each time, since compiled kernels are kept by place and time of change.
    """

    def __init__(self, root: Path, folder: Path, most_s: float) -> None:
        self.root, self.tree, self.most_s = root, folder / "tree", most_s
        self._scratch, self._log = folder / "t", folder / "output.txt"
        self._times = folder / "seconds.json"
        shutil.rmtree(self.tree, ignore_errors=True)
        shutil.copytree(root, self.tree, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        compileall.compile_dir(self.tree, quiet=2)  # once: no mutant's bytecode is written
        known = json.loads(self._times.read_text()) if self._times.exists() else {}
        self.seconds: dict[str, float | None] = {
            test: took for test, (took, of) in known.items() if of == _digest(self.tree / test)
        }

    def tests(self, module: str) -> list[str]:
        """Test files for a mutant of `module`; those whose time is not known are timed."""
        files = chosen(self.tree, module, self.seconds, self._measure, self.most_s)
        known = {test: (took, _digest(self.tree / test)) for test, took in self.seconds.items()}
        self._times.write_text(json.dumps(known, indent=1))
        return files

    def _measure(self, test: str) -> float | None:
        """How long a test file takes without a mutant, s; None if it fails (or has no tests)."""
        started = time.monotonic()
        outcome = self.run([test], 10 * self.most_s)
        took = round(time.monotonic() - started, 1)
        if outcome != "survived":
            print(f"{test} is left out: {outcome} without any mutant\n{self.output()}", flush=True)
            return None
        return took

    def output(self) -> str:
        """The last lines that tests printed."""
        return "\n".join(self._log.read_text(errors="replace").splitlines()[-12:])

    def attempt(self, path: str, changed: str, files: list[str]) -> str:
        """What test files do with a file changed: killed, survived, timed out."""
        at = self.tree / path
        at.write_text(changed)
        try:
            return self.run(files, 4 * sum(self.seconds[test] or 0.0 for test in files) + 120)
        finally:
            shutil.copy2(self.root / path, at)  # with the time of its change

    def run(self, files: list[str], limit_s: float) -> str:
        """Run test files in the copy."""
        environment = dict(os.environ, PYTHONPATH=str(self.tree), PYTHONDONTWRITEBYTECODE="1")
        environment[_MARK] = str(self.tree)
        words = [
            "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider",
            f"--basetemp={self._scratch}", *files,
        ]  # fmt: skip
        with self._log.open("w") as log:
            child = subprocess.Popen(
                [sys.executable, *words], cwd=self.tree, env=environment, start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip
            try:
                code = child.wait(limit_s)
            except subprocess.TimeoutExpired:
                return "timed out"
            finally:
                _end_all(self.tree)
                child.wait()
        return "survived" if code == 0 else "killed"


@contextmanager
def copy_of(root: Path, most_s: float, folder: Path | None = None) -> Iterator[Copy]:
    """A copy of the sources, in a folder among the temporary ones that stays. Raises Busy."""
    if folder is None:
        name = hashlib.sha256(bytes(root)).hexdigest()[:8]
        folder = Path(tempfile.gettempdir()).resolve() / f"hertzloop-mutants-{os.getuid()}-{name}"
    own(folder, alone=True)
    with (folder / "lock").open("w") as lock:
        try:
            flock(lock, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            raise Busy(f"{folder} is in use by another run of this command") from None
        yield Copy(root, folder, most_s)


def _end_all(tree: Path) -> None:
    """End what tests have left behind: a mutant may keep a run from ending its processes."""
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get(_MARK) == str(tree):
                process.send_signal(signal.SIGKILL)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""
