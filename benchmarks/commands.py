"""Commands of one or two checkouts, run in turn, and what they take."""

import ctypes
import os
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

ROOT = Path(__file__).resolve().parent.parent
_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER: orphans of a command become children of this process

BeforeOption = Annotated[
    Path | None,
    typer.Option(
        "--before",
        help="Measure the checkout in this folder too, in turn.",
        metavar="PATH",
        exists=True,
        file_okay=False,
        resolve_path=True,
    ),
]


@dataclass(frozen=True)
class Taken:
    """What one command took: time (s), and processor time of all of its processes (s)."""

    wall_s: float
    cpu_s: float


def checkouts(before: Path | None) -> dict[str, Path]:
    """Folders of the checkouts by name: "this", and "before" if there is one."""
    return {"this": ROOT} | ({"before": before} if before else {})


def environment_of(checkout: Path) -> dict[str, str]:
    """The environment of a process that runs the code of a checkout."""
    return {**os.environ, "PYTHONPATH": str(checkout)}


@contextmanager
def _all_processes() -> Iterator[None]:
    """Become the parent of every process whose parent has ended, to wait for it."""
    control = ctypes.CDLL(None).prctl
    control(_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        control(_SUBREAPER, 0, 0, 0, 0)


def _children() -> set[int]:
    """Numbers of the processes whose parent is this one."""
    here = os.getpid()
    return set(map(int, Path(f"/proc/{here}/task/{here}/children").read_text().split()))


def take(
    words: Sequence[str], checkout: Path, folder: Path, more: Mapping[str, str] | None = None
) -> Taken:
    """Run a command that uses the code of a checkout, to the end of all of its processes.

    Args:
        words: the command.
        checkout: folder that holds `hertzloop`.
        folder: working folder; the output goes to `said.txt` there.
        more: further variables of its environment.

    Raises:
        subprocess.CalledProcessError: the command failed.
    """
    environment = environment_of(checkout) | dict(more or {})
    said, known = folder / "said.txt", _children()
    with _all_processes(), said.open("w") as file:
        began = time.perf_counter()
        process = subprocess.Popen(words, cwd=folder, env=environment, stdout=file, stderr=file)
        _, status, used = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        all_used = [used]
        while orphans := _children() - known:
            all_used += [os.wait4(number, 0)[2] for number in orphans]
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args, said.read_text())
    cpu_s = sum(one.ru_utime + one.ru_stime for one in all_used)
    return Taken(wall_s, cpu_s)
