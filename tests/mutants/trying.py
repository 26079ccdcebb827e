"""Tests run on mutants in a copy of the sources: the sources themselves are never touched."""

import compileall
import hashlib
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path

import psutil

from hertzloop.common.jit.folder import make_private
from tests.mutants.choosing import chosen

_NOT_COPIED = (".git", "__pycache__", ".*_cache", ".venv", "venv", ".hypothesis")
_MARK = "HERTZLOOP_MUTANTS"  # in the environment of all that a test starts, and its children
_LIMIT_S = 1200.0  # of all tests of a mutant; each has the limit of its own of the test suite


class Busy(Exception):
    """The copy is in use by another such command."""


class Copy:
    """A copy of the sources at `root`, and what is known of their tests.

    It has the same place each time, since compiled kernels are kept by place and time of change.
    """

    def __init__(self, root: Path, folder: Path, most_s: float, default: bool) -> None:
        self.root, self.tree, self.most_s = root, folder / "tree", most_s
        self._tier = ["-m", "not full and not soak"] if default else []
        self._scratch, self._log = folder / "t", folder / "output.txt"
        self._times = folder / f"seconds{'-default' * default}.json"
        shutil.rmtree(self.tree, ignore_errors=True)
        shutil.copytree(root, self.tree, symlinks=True, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        compileall.compile_dir(self.tree, quiet=2)  # once: no mutant's bytecode is written
        known = json.loads(self._times.read_text()) if self._times.exists() else {}
        self.seconds: dict[str, float | None] = {
            test: took for test, (took, of) in known.items() if of == _digest(self.tree / test)
        }

    def tests(self, module: str, near: bool) -> list[str]:
        """Test files for a mutant of `module`, in its own folder's or elsewhere; those whose time
        is not known are timed."""
        files = chosen(self.tree, module, near, self.seconds, self._measure, self.most_s)
        known = {test: (took, _digest(self.tree / test)) for test, took in self.seconds.items()}
        self._times.write_text(json.dumps(known, indent=1))
        return files

    def _measure(self, test: str) -> float | None:
        """Processor time that a test file takes without a mutant, s; None if it fails, or takes
        far longer than there is for a mutant."""
        outcome, took = self.run([test], most_s=1.5 * self.most_s)
        if outcome == "survived":
            return took
        print(f"{test} is left out: {outcome} without any mutant\n{self.output()}", flush=True)
        return None

    def output(self) -> str:
        """The last lines that tests printed."""
        return "\n".join(self._log.read_text(errors="replace").splitlines()[-12:])

    def attempt(self, path: str, changed: str) -> tuple[str, list[str]]:
        """What tests do with a file changed: killed, survived, timed out; and which were run,
        near ones first."""
        files: list[str] = []
        for near in (True, False):
            more = self.tests(path, near)
            files += more
            (self.tree / path).write_text(changed)
            # Python tells bytecode of the original by size and whole seconds of the change.
            later = (self.root / path).stat().st_mtime + 2.0
            os.utime(self.tree / path, (later, later))
            try:
                outcome = self.run(more)[0] if more else "survived"
            finally:
                shutil.copy2(self.root / path, self.tree / path)  # with the time of its change
            if outcome != "survived":
                break
        return outcome, files

    def run(
        self, files: list[str], limit_s: float = _LIMIT_S, most_s: float = _LIMIT_S
    ) -> tuple[str, float]:
        """Run test files in the copy: what came of it, and the processor time it took, s; its
        own, without that of its children, is `most_s` at most."""
        words = [
            *(sys.executable, "-P", "-m", "pytest", "-x", "-q", "-n", "0"),
            *("-p", "no:cacheprovider", f"--basetemp={self._scratch}", *self._tier, *files),
        ]
        tree = str(self.tree)
        own = {"PYTHONPATH": tree, "PYTHONDONTWRITEBYTECODE": "1", _MARK: tree}
        most = (math.ceil(most_s),) * 2
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with self._log.open("w") as log:
            process = subprocess.Popen(
                words,
                cwd=tree,
                env=os.environ | own,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, most),
            )
            code = None
            try:
                code = process.wait(limit_s)
            except subprocess.TimeoutExpired:
                pass
            finally:  # also when interrupted
                process.kill()
                process.wait()
                _end_all(self.tree)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        unnoticed = code in (0, 5)  # 5: no test of the tier in these files
        outcome = "timed out" if code is None else "survived" if unnoticed else "killed"
        took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return outcome, round(took, 2)


@contextmanager
def copy_of(
    root: Path, most_s: float, default: bool = False, folder: Path | None = None
) -> Iterator[Copy]:
    """A copy of the sources, in a folder among the temporary ones that stays. Raises Busy.

    `default`: run only tests of the default tier.
    """
    if folder is None:
        name = hashlib.sha256(bytes(root)).hexdigest()[:8]
        folder = Path(tempfile.gettempdir()).resolve() / f"hertzloop-mutants-{os.getuid()}-{name}"
    make_private(folder)
    with (folder / "lock").open("w") as lock:
        try:
            flock(lock, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            raise Busy(f"{folder} is in use by another run of this command") from None
        yield Copy(root, folder, most_s, default)


def _end_all(tree: Path) -> None:
    """End what tests have left behind: a mutant may keep a run from ending its processes."""
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get(_MARK) == str(tree):
                process.send_signal(signal.SIGKILL)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""
