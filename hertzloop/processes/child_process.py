"""A process of a run: how it is started, what it reports, and which one is the cause of a failure.

A role is a fork of the launcher, which has imported everything and built the scene's parts. A
process with several threads cannot be forked safely: then a role is a fork of the fork server of
`multiprocessing`, which imports everything once.
"""

import gc
import multiprocessing
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, NoReturn

from setproctitle import setproctitle

from hertzloop.bus.port import BusError, EndedByOther, PeerLost
from hertzloop.bus.streams import CONTROLLER, StreamFault
from hertzloop.processes.program import how_it_failed
from hertzloop.processes.signals import INTERRUPTED, end_with_parent, install_handlers
from hertzloop.recordings.writer import RecordingError

_PROGRESS_S = 0.1  # between two reports of a step
# What roles need. Imported before they are forked.
MODULES = [
    "hertzloop.loop.controller_node",
    "hertzloop.loop.plant_node",
    "hertzloop.processes.roles",
]

Report = Callable[..., None]  # takes the parts of a report by name


@dataclass
class RoleFault:
    """Why a role has ended, in a sentence.

    Attributes:
        others: Whether another role is the reason.
        lost: Roles that it has missed.
        at_s: When it noticed, by a clock that all processes of a host share.
    """

    sentence: str
    others: bool = False
    lost: tuple[str, ...] = ()
    at_s: float = field(default_factory=time.monotonic)


@dataclass(eq=False)
class ChildProcess:
    """A process of a run, and what it has reported.

    Attributes:
        role: Its role in the run.
        process: The process.
        stderr: File with its standard error.
        pipe: Where its reports come from; what is sent there lets a program begin.
        command: Command line of the user's program that plays the role; "" if it is ours.
        ready: Whether it takes part in the run.
        fault: Why it has ended, as it says.
        done: Its result, once it has done its part.
        code: Its exit code, once it has ended; negative for a signal.
    """

    role: str
    process: BaseProcess
    stderr: Path
    pipe: Connection
    command: str = ""
    ready: bool = False
    fault: RoleFault | None = None
    done: dict[str, Any] = field(default_factory=dict)
    code: int | None = None

    @property
    def failed(self) -> bool:
        """Whether it has ended before its part was done."""
        return self.code is not None and not self.done

    @property
    def running(self) -> bool:
        """Whether its part is neither done nor given up."""
        return self.code is None and not self.done

    def own_reason(self) -> str:
        """Return why it failed, if for a reason of its own; "" if another role was the reason."""
        assert self.code is not None  # it has ended
        if self.fault and self.code >= 0:
            return "" if self.fault.others else self.fault.sentence
        if self.code == INTERRUPTED:
            return f"{self.role} was interrupted"
        return f"{self.role} {how_it_failed(self.code, self.stderr)}"


def failure_cause(children: Iterable[ChildProcess], law: str = "") -> str:
    """Return the sentence that explains why a run failed.

    A process that failed for a reason of its own explains it: one that was killed, then the first
    that reports a fault. For example, if the controller is killed and plant and recorder report
    that they lost it, the cause is "controller was killed by SIGKILL". If no process has a reason
    of its own, the first one that missed another explains the failure, with the role that was
    stopped at that moment, or that still runs: that one hangs.

    Args:
        children: The processes of the run.
        law: Name of the law, if it is not a shipped one. It may hang.
    """
    failed = sorted(
        (child for child in children if child.failed),
        key=lambda child: child.fault.at_s if child.fault else 0.0,
    )
    # A program of the user's exits with a code of its own after it was told of a fault.
    for child in sorted(failed, key=lambda c: (bool(c.command), (c.code or 0) >= 0)):
        if (reason := child.own_reason()) and not _was_missed_before(child, failed):
            told = [one.fault for one in failed if one.fault and one.fault.others]
            # What it says on the bus tells more than how it then exits.
            if child.command and not any(fault.lost for fault in told):
                return next((fault.sentence for fault in told), reason)
            return reason
    faults = [child.fault for child in failed if child.fault]
    running = {child.role for child in children if child.running}
    missing = [fault for fault in faults if running & {*fault.lost}]
    first = next(iter([*missing, *(fault for fault in faults if fault.lost), *faults]))
    if hung := running & {*first.lost}:
        hangs = f", perhaps in an endless loop of the law {law}" * bool(law)
        return not_responding(hung, first.sentence, hangs if CONTROLLER in hung else "")
    return first.sentence


def _was_missed_before(child: ChildProcess, failed: Iterable[ChildProcess]) -> bool:
    """Whether the fault of a process follows from its absence: it then lacks messages."""
    return (
        child.fault is not None
        and (child.code or 0) > 0
        and child.code != INTERRUPTED
        and any(
            child.role in one.fault.lost and one.fault.at_s < child.fault.at_s
            for one in failed
            if one.fault
        )
    )


def not_responding(roles: Iterable[str], how: str, why: str = "") -> str:
    """Return the sentence on roles that do not respond: how this was noticed, and perhaps why."""
    named = sorted(roles)
    verb = "does" if len(named) == 1 else "do"
    return f"{' and '.join(named)} {verb} not respond{why}; {how}"


def start_role(
    role: str,
    stderr: Path,
    title: str,
    work: Callable[..., dict[str, Any]],
    *arguments: object,
    command: str = "",
) -> ChildProcess:
    """Start a process that calls `work(report, *arguments)` and reports what that returns.

    Call it while the ending signals are `deferred`: the process lets them in once it is ready.

    Args:
        role: Its role in the run.
        stderr: File that takes its standard error.
        title: How the system lists it.
        work: A function of a module.
        arguments: What can be sent to another process.
        command: Command line of a program of the user's, which `work` then runs once something is
            sent to the process.

    Raises:
        BusError: this process may have no children.
        OSError: the system refuses another process.
    """
    if multiprocessing.current_process().daemon:
        raise BusError(
            "a worker of multiprocessing.Pool cannot start the processes of a run. Use "
            "concurrent.futures, or transport = 'compiled'"
        )
    alone = len(os.listdir("/proc/self/task")) == 1  # no thread, be it of Python or not
    context = multiprocessing.get_context("fork" if alone else "forkserver")
    if not alone:
        context.set_forkserver_preload(MODULES)
    ours, theirs = context.Pipe()
    home = _Home(os.getpid(), dict(os.environ), stderr, title)
    whole = (home, theirs, bool(command), work, *arguments)
    process = context.Process(target=_be_role, args=whole, name=role, daemon=True)  # type: ignore[attr-defined]
    with nullcontext() if alone else _without_main():
        process.start()
    theirs.close()
    return ChildProcess(role, process, stderr, ours, command)


@contextmanager
def _without_main() -> Iterator[None]:
    """Let a process of the fork server not import the user's script, which may start a run."""
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class _Home(NamedTuple):
    """Where a role is at home: its launcher, environment, file of errors, title."""

    launcher: int
    environment: dict[str, str]
    stderr: Path
    title: str


def _be_role(home: _Home, pipe: Connection, waits: bool, work: Any, *arguments: object) -> NoReturn:
    """Do the work of a role in this process, report what came of it, and end the process."""
    code, told_s = 1, 0.0

    def report(**parts: object) -> None:
        nonlocal told_s
        if "step" in parts:
            # How far it is may be left out while the launcher is stopped; the rest is little.
            if time.monotonic() - told_s < _PROGRESS_S or not select.select([], [pipe], [], 0.0)[1]:
                return
            told_s = time.monotonic()
        pipe.send(parts)

    try:
        _settle(home)
        if waits:
            pipe.recv()
        report(done=work(report, *arguments))
        code = 0
    except KeyboardInterrupt as error:
        report(fault=RoleFault(str(error) or f"{home.title.split()[1]} was interrupted"))
        code = INTERRUPTED
    except (BusError, StreamFault, RecordingError) as error:
        lost = error.roles if isinstance(error, PeerLost) else ()
        at_s = error.at_s if isinstance(error, PeerLost) else time.monotonic()
        others = isinstance(error, PeerLost | EndedByOther)
        report(fault=RoleFault(str(error), others, lost, at_s))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)  # at once: zenoh's threads may still call Python, which then aborts


def _settle(home: _Home) -> None:
    """Make this process one of its own: it ends with its launcher, and Ctrl-C in the launcher's
    terminal does not reach it, since the launcher ends the roles in order."""
    setproctitle(home.title)  # before the environment, next to which the system keeps it
    os.setsid()
    end_with_parent()
    os.kill(home.launcher, 0)  # raises if that has ended before
    os.environ.clear()
    os.environ.update(home.environment)  # the fork server may have another one
    with open(os.devnull, "r+b") as nothing, home.stderr.open("wb") as errors:
        for number, file in enumerate((nothing, nothing, errors)):
            os.dup2(file.fileno(), number)
    # The caller may have replaced them, as pytest and notebooks do.
    sys.stdin, sys.stdout = open(0), open(1, "w")  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1)  # noqa: SIM115
    gc.freeze()  # the pages of what was loaded before a fork stay shared
    signal.set_wakeup_fd(-1)
    install_handlers()
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
