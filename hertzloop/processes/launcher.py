"""Start plant, controller and recorder as processes, supervise them, end them together."""

import json
import math
import os
import queue
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from signal import SIGKILL
from typing import Any

from hertzloop.bus.sockets import mesh_endpoints, own_endpoints, own_folder
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.loop.run_options import USUAL_RUN, RunOptions
from hertzloop.processes import fork_server
from hertzloop.processes.child_process import ChildProcess
from hertzloop.processes.failure_cause import failure_cause, not_responding
from hertzloop.processes.program import filled_in
from hertzloop.processes.signals import Interrupted, ending_signals
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml

_START_S = 180.0  # for all to appear: a death is told at once, kernels may have to be compiled
_CONNECTS_S = 30.0  # for a program of the user's to connect
_GRACE_S = 6.0  # for the others to notice a fault, close their files and leave the bus
# For a process to react to a signal (roles.py has the shorter wait after which a role exits by
# itself), or to exit once it has done its part.
_PATIENCE_S = 5.0
_REPORT_S = 1.0  # for reports of others to arrive, once a program has ended
_LEAVE_S = 15.0  # for the others to do their part, once one has: all was recorded before
_LOOK_S = 0.2
_SCENE = "scene.toml"


class RunFailed(RuntimeError):
    """A process of the run failed. The message names the first cause."""

    exit_status = 1


class Launcher:
    """Runs a scene as three processes. Use as a context manager: leaving it ends them all."""

    def __init__(
        self,
        setup: Setup,
        recording: Path,
        options: RunOptions = USUAL_RUN,
        wait_s: float = _START_S,
    ) -> None:
        self._reports: queue.SimpleQueue[tuple[ChildProcess, dict[str, Any]] | None] = (
            queue.SimpleQueue()
        )
        self._signals = 0
        self._setup, self._options = setup, options
        self._in_use = ExitStack()
        self.children: list[ChildProcess] = []
        self._commands = {
            RECORDER: ["node", "recorder", "--out", str(recording)],
            CONTROLLER: ["node", "controller"],
            PLANT: ["node", "plant", _SCENE],
        }
        self._program = options.controller  # in place of our own
        if self._program:
            del self._commands[CONTROLLER]
            wait_s = min(wait_s, _CONNECTS_S)
        self._wait_s, timeout_s = wait_s, options.timeout_s
        self._silence_s = wait_s + 2 * timeout_s  # a role that waits or runs reports before

    def _words(self, role: str, name: str, endpoints: Sequence[str]) -> list[str]:
        listen, connect = mesh_endpoints(role, endpoints)
        words = self._options.model_copy(update={"name": name}).words(role)
        for option, chosen in (("--listen", listen), ("--connect", connect)):
            words += [word for endpoint in chosen for word in (option, endpoint)]
        return [*words, "--wait", str(self._wait_s), "--machine"]

    def _start(
        self, role: str, arguments: list[str], folder: Path, program: str = ""
    ) -> ChildProcess:
        arguments = [str(folder / word) if word == _SCENE else word for word in arguments]
        stderr = folder / f"{role}.stderr"
        # A role has its own session: Ctrl-C comes to the launcher, which ends the roles in order.
        # Nothing is written to its standard input, which ends with the launcher, however that ends.
        process = fork_server.start(arguments, stderr, {}, bool(program))
        child = ChildProcess(role, process, stderr, program)
        self.children.append(child)
        threading.Thread(target=self._listen, args=(child,), daemon=True).start()
        return child

    def _listen(self, child: ChildProcess) -> None:
        for line in child.process.stdout:
            if child.program:
                continue  # it is for people
            try:
                self._reports.put((child, json.loads(line)))
            except json.JSONDecodeError:
                continue
        child.process.wait()
        self._reports.put((child, {"exited": True}))

    def __enter__(self) -> "Launcher":
        with ExitStack() as stack:
            stack.enter_context(ending_signals(self._on_signal))
            folder = stack.enter_context(own_folder())
            (Path(folder) / _SCENE).write_text(to_toml(self._setup.scene), encoding="utf-8")
            endpoints = self._options.endpoints or stack.enter_context(own_endpoints())
            name = self._options.name or f"run-{os.getpid()}-{secrets.token_hex(4)}"
            self._place = Path(folder), name, endpoints
            stack.callback(self._end_all)
            for role, command in self._commands.items():
                words = self._words(role, name, endpoints)
                self._start(role, [*command, *words], Path(folder))
            self._in_use = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._in_use.close()

    def _on_signal(self, count: int) -> None:
        self._signals = count
        self._reports.put(None)

    def wait(self, on_progress: Callable[[int], None] = lambda step: None) -> dict[str, Any]:
        """Wait for the end of the run; return the plant's statistics.

        Raises RunFailed with the sentence of whoever failed first for a reason of its own, and
        Interrupted after a signal.
        """
        running = {child.role: child for child in self.children}
        failed: list[ChildProcess] = []  # in the order of their ends
        deadline, looks = math.inf, 0  # in vain; none is made while this process is stopped
        left, left_s = None, math.inf  # a program that ended without an error, and when
        while running and time.monotonic() < deadline:
            reported = time.monotonic() - left_s > _REPORT_S and self._reports.empty()
            if left and reported and not any(c.ready for c in self.children):
                left.fault = f"{left.named} ended before the run began"
                failed.append(left)
                break
            try:
                item = self._reports.get(timeout=_LOOK_S)
            except queue.Empty:
                looks += 1
                if deadline == math.inf and looks * _LOOK_S > self._silence_s:
                    how = f"the launcher has received nothing for {self._silence_s:g} s"
                    raise RunFailed(not_responding(running, how)) from None
                continue
            if item is None:
                raise Interrupted
            child, report = item
            if "open" in report and self._program:  # not every program tries to connect again
                folder, name, endpoints = self._place
                words = filled_in(self._program, name, endpoints)
                running[CONTROLLER] = self._start(CONTROLLER, words, folder, self._program)
            looks = 0
            if "step" in report:
                on_progress(report["step"])
            for name in ("ready", "fault", "others", "lost", "at_s", "done"):
                setattr(child, name, report.get(name, getattr(child, name)))
            if child.program and "exited" in report and not child.process.returncode:
                child.done = {"left": True}
                left, left_s = child, time.monotonic()
            if child.done:  # whatever becomes of the process now
                running.pop(child.role, None)
                own = running.keys() - {CONTROLLER} or not self._program
                deadline = min(deadline, time.monotonic() + (_LEAVE_S if own else _PATIENCE_S))
            elif "exited" in report:
                del running[child.role]
                failed.append(child)
            if failed:
                # Who still waits for the others to appear would wait for nothing.
                known = any(c.own_reason() for c in failed)
                in_vain = known and not any(c.ready for c in running.values())
                deadline = min(deadline, time.monotonic() + (0.0 if in_vain else _GRACE_S))
        if failed:
            own = not self._setup.scene.controller.law_is_shipped and not self._program
            law = loaded_law(self._setup).name if own else ""
            raise RunFailed(failure_cause(failed, set(running), law))
        return self._statistics(running)

    def _statistics(self, running: dict[str, ChildProcess]) -> dict[str, Any]:
        """Return what the roles report of a run in which none failed; `running`: who has not ended.

        Raises RunFailed if one of these is no program of the user's.
        """
        if self._program and running.keys() == {CONTROLLER}:  # it might serve another run
            program = running.pop(CONTROLLER)
            program.process.terminate()
            program.done = {"left": False}
        if running:
            ended = f"the others had ended their part of the run {_LEAVE_S:g} s before"
            raise RunFailed(not_responding(running, ended))
        stats = next(c.done for c in self.children if c.role == PLANT)
        busy_s = {c.role: c.done["busy_s"] for c in reversed(self.children) if "busy_s" in c.done}
        return stats | {"busy_s": busy_s}

    def _end_all(self) -> None:
        """Let processes exit that have done their part; end the others, the plant first: it tells
        them, and they close in order.

        A second signal cuts the waiting short.
        """
        Role = fork_server.Role
        stages: list[tuple[Callable[[fork_server.Role], None], Sequence[str]]] = [
            (Role.terminate, (PLANT,)),
            (Role.terminate, ROLES),
            (Role.kill, ROLES),
        ]
        if not any(child.ready for child in self.children):
            del stages[0]  # they have not met
        if all(child.done for child in self.children):
            stages.insert(0, (lambda _: None, ROLES))
        for end, roles in stages:
            chosen = [c for c in self.children if c.role in roles and c.process.poll() is None]
            for child in chosen:
                end(child.process)
            deadline = time.monotonic() + _PATIENCE_S
            while chosen and any(c.process.poll() is None for c in self.children):
                hurry = self._signals > 1 and end is not Role.kill
                if hurry or time.monotonic() > deadline:
                    break
                time.sleep(0.01)
        for child in self.children:
            child.process.stdin.close()
            if child.program:  # a shell's, too
                with suppress(ProcessLookupError):
                    os.killpg(child.process.pid, SIGKILL)
