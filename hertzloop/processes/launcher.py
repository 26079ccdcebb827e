"""Start plant, controller and recorder as processes, supervise them, end them together."""

import math
import os
import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from hertzloop.bus.sockets import mesh_endpoints, run_folder
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.loop.announcement import versions_here
from hertzloop.loop.run_options import USUAL_RUN, RunOptions
from hertzloop.processes.child_process import (
    MODULES,
    ChildProcess,
    Report,
    RoleFault,
    failure_cause,
    not_responding,
    start_role,
)
from hertzloop.processes.program import filled_in, run_program
from hertzloop.processes.signals import Interrupted, deferred, ending_signals
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup

_START_S = 180.0  # for all to appear: a death is told at once
_CONNECTS_S = 30.0  # for a program of the user's to connect
_GRACE_S = 6.0  # for the others to notice a fault, close their files and leave the bus
# For a process to react to a signal (roles.py has the shorter wait after which a role exits by
# itself), or to exit once it has done its part.
_PATIENCE_S = 5.0
_LEAVE_S = 15.0  # for the others to do their part, once one has: all was recorded before
_LOOK_S = 0.2


class RunFailed(RuntimeError):
    """A process of the run failed. The message names the first cause."""

    exit_status = 1


class Launcher:
    """Runs a scene as three processes. Use as a context manager: leaving it ends them all.

    Enter it before anything starts a thread, since processes with threads are not forked.

    Attributes:
        name: Name of the run on the bus.
        endpoints: Where plant, controller and recorder listen.
    """

    def __init__(
        self,
        setup: Setup,
        recording: Path,
        options: RunOptions = USUAL_RUN,
        wait_s: float = _START_S,
    ) -> None:
        self._setup, self._recording, self._options = setup, recording, options
        self.name = options.name or f"run-{os.getpid()}-{secrets.token_hex(4)}"
        self.endpoints: Sequence[str] = options.endpoints or ()
        self.children: list[ChildProcess] = []
        self._wait_s = min(wait_s, _CONNECTS_S) if options.controller else wait_s
        self._silence_s = self._wait_s + 3 * options.timeout_s  # a role gives up before
        self._signals = 0
        self._in_use = ExitStack()

    def __enter__(self) -> "Launcher":
        with ExitStack() as stack:
            self._folder, private = stack.enter_context(run_folder())
            self.endpoints = self.endpoints or private
            stack.callback(self._end_all)
            for module in MODULES:
                import_module(module)
            versions_here()  # read from the disk, and kept
            with deferred():
                for role in (RECORDER, CONTROLLER, PLANT):
                    self._start(role)
            stack.enter_context(ending_signals(self._on_signal))
            self._in_use = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._end_all()  # while signals are still counted
        self._in_use.close()

    def _start(self, role: str) -> None:
        listen, connect = mesh_endpoints(role, self.endpoints)
        options = self._options.model_copy(update={"name": self.name})
        title = f"hertzloop {role} --name {self.name}"
        title += f" --out {self._recording}" * (role == RECORDER)
        stderr, command = self._folder / f"{role}.stderr", ""
        work: Callable[..., dict[str, Any]] = _play
        setup = self._setup if role == PLANT else None
        given: tuple[object, ...]
        given = (role, setup, self._recording, options, listen, connect, self._wait_s)
        if role == CONTROLLER and options.controller:
            work, command = run_program, options.controller
            given = (command, filled_in(command, self.name, self.endpoints), stderr)
        self.children.append(start_role(role, stderr, title, work, *given, command=command))

    def _on_signal(self, count: int) -> None:
        self._signals = count

    def wait(self, on_progress: Callable[[int], None] = lambda step: None) -> dict[str, Any]:
        """Wait for the end of the run; return the plant's statistics.

        Raises RunFailed with the sentence of whoever failed first for a reason of its own, and
        Interrupted after a signal.
        """
        deadline, looks = math.inf, 0  # in vain; none is made while this process is stopped
        while self._running() and time.monotonic() < deadline:
            if self._signals:
                raise Interrupted
            if self._hear(on_progress):
                looks, deadline = 0, min(deadline, time.monotonic() + self._patience_s())
            else:
                looks += 1
            if deadline == math.inf and looks * _LOOK_S > self._silence_s:
                how = f"the launcher has received nothing for {self._silence_s:g} s"
                raise RunFailed(not_responding(self._running(), how))
        if any(child.failed for child in self.children):
            own = not self._setup.scene.controller.law_is_shipped and not self._options.controller
            law = loaded_law(self._setup).name if own else ""
            raise RunFailed(failure_cause(self.children, law))
        return self._statistics()

    def _running(self) -> list[str]:
        """Return the roles that have neither done their part nor ended."""
        return [child.role for child in self.children if child.running]

    def _hear(self, on_progress: Callable[[int], None]) -> bool:
        """Take in what the processes report within a moment; return whether one did."""
        ready = wait([child.pipe for child in self.children if child.code is None], _LOOK_S)
        for child in self.children:
            if child.pipe not in ready:
                continue
            try:
                while child.pipe.poll():
                    self._take_in(child, child.pipe.recv(), on_progress)
            except (EOFError, OSError):  # it ends
                child.process.join(_PATIENCE_S)
                child.code = 1 if child.process.exitcode is None else child.process.exitcode
        for child in self.children:
            if child.command and child.done and not any(one.ready for one in self.children):
                child.done = {}
                child.fault = RoleFault(
                    f"{child.role} ('{child.command}') ended before the run began"
                )
        return bool(ready)

    def _take_in(
        self, child: ChildProcess, report: dict[str, Any], on_progress: Callable[[int], None]
    ) -> None:
        """Take in a report."""
        if report.get("open") == PLANT:
            for program in (one for one in self.children if one.command):
                with suppress(OSError):  # it has ended, which its own pipe tells
                    program.pipe.send("begin")  # not every program tries to connect again
        if "step" in report:
            on_progress(report["step"])
        child.ready = child.ready or "ready" in report
        child.fault = report.get("fault", child.fault)
        child.done = report.get("done", child.done)

    def _patience_s(self) -> float:
        """Return how long the others are waited for, once one has failed or has done its part."""
        failed = [child for child in self.children if child.failed]
        if failed:
            # Who still waits for the others to appear would wait for nothing.
            known = any(child.own_reason() for child in failed)
            going = any(child.ready for child in self.children if child.running)
            return 0.0 if known and not going else _GRACE_S
        if any(child.done for child in self.children):
            program = self._options.controller and self._running() == [CONTROLLER]
            return _PATIENCE_S if program else _LEAVE_S
        return math.inf

    def _statistics(self) -> dict[str, Any]:
        """Return what the plant reports of a run in which no role failed.

        Raises RunFailed if one of ours has not ended.
        """
        running = self._running()
        if self._options.controller and running == [CONTROLLER]:  # it might serve another run
            running = []
        if running:
            ended = f"the others had ended their part of the run {_LEAVE_S:g} s before"
            raise RunFailed(not_responding(running, ended))
        return next(child.done for child in self.children if child.role == PLANT)

    def _end_all(self) -> None:
        """Let processes exit that have done their part; end the others, the plant first: it tells
        them, and they close in order.

        A second signal cuts the waiting short.
        """
        stages: list[tuple[str, Sequence[str]]] = [
            ("terminate", (PLANT,)),
            ("terminate", ROLES),
            ("kill", ROLES),
        ]
        if not any(child.ready for child in self.children):
            del stages[0]  # they have not met
        if all(child.done for child in self.children):
            stages.insert(0, ("", ()))
        for end, roles in stages:
            for child in self.children:
                if child.role in roles and child.process.exitcode is None:
                    getattr(child.process, end)()
            deadline = time.monotonic() + _PATIENCE_S
            while any(child.process.exitcode is None for child in self.children):
                hurry = self._signals > 1 and end != "kill"
                if hurry or time.monotonic() > deadline:
                    break
                time.sleep(0.01)
        while self.children:
            child = self.children.pop()
            child.pipe.close()
            if child.process.exitcode is not None:
                child.process.close()


def _play(
    report: Report,
    role: str,
    setup: Setup | None,
    recording: Path,
    options: RunOptions,
    listen: Sequence[str],
    connect: Sequence[str],
    wait_s: float,
) -> dict[str, Any]:
    """Play a role of a run in this process; return its statistics."""
    from hertzloop.processes import roles

    address = roles.BusAddress(listen=listen, connect=connect, wait_s=wait_s)
    if role == RECORDER:
        return roles.run_recorder(recording, address, options, report)
    if role == CONTROLLER:
        return roles.run_controller(address, options, report)
    assert setup is not None
    return roles.run_plant(setup, address, options, report)
