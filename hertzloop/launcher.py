"""Start plant, controller and recorder as processes, watch them, end them together."""

import json
import os
import queue
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.processes import default_endpoints
from hertzloop.scene import Scene, to_toml

_GRACE_S = 3.0  # for the others to notice a fault and close their files
_PATIENCE_S = 2.0  # for a process to react to a signal
_ALL = {PLANT, CONTROLLER, RECORDER}


class RunFailed(RuntimeError):
    """A process of the run failed; the sentence is that of the first cause."""


@dataclass
class Child:
    """One process of a run and what it reported."""

    role: str
    process: subprocess.Popen[str]
    stderr: Path
    fault: str = ""
    lost_a_peer: bool = False
    done: dict[str, Any] = field(default_factory=dict)


def free_ports(count: int) -> list[int]:
    """TCP ports on loopback that are free at this moment."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for s in sockets:
            s.bind(("127.0.0.1", 0))
        return [s.getsockname()[1] for s in sockets]
    finally:
        for s in sockets:
            s.close()


class Launcher:
    """Runs a scene as three processes. Use as a context manager: leaving it ends them all."""

    def __init__(
        self,
        scene: Scene,
        recording: Path,
        *,
        overwrite: bool = False,
        horizon: int | None = None,
        ports: Sequence[int] | None = None,
        name: str | None = None,
        timeout_s: float = 5.0,
        wait_s: float = 30.0,
    ) -> None:
        self._reports: queue.SimpleQueue[tuple[Child, dict[str, Any]]] = queue.SimpleQueue()
        self._folder = tempfile.TemporaryDirectory(prefix="hertzloop-")
        self.children: list[Child] = []
        scene_file = Path(self._folder.name) / "scene.toml"
        scene_file.write_text(to_toml(scene), encoding="utf-8")
        ports = ports or free_ports(3)
        name = name or f"run-{os.getpid()}-{ports[0]}"
        arguments = {
            RECORDER: ["record", "--out", str(recording)] + ["--overwrite"] * overwrite,
            CONTROLLER: ["controller"],
            PLANT: ["plant", str(scene_file)] + (["--horizon", str(horizon)] if horizon else []),
        }
        for role, words in arguments.items():
            listen, connect = default_endpoints(role, ports)
            bus = ["--name", name, "--timeout", str(timeout_s), "--wait", str(wait_s)]
            bus += [word for url in listen for word in ("--listen", url)]
            bus += [word for url in connect for word in ("--connect", url)]
            self._start(role, [*words, *bus, "--machine"])

    def _start(self, role: str, words: list[str]) -> None:
        stderr = Path(self._folder.name) / f"{role}.stderr"
        with stderr.open("w") as sink:
            process = subprocess.Popen(
                # -P: a folder of the user's that is called like one of ours must not be imported
                [sys.executable, "-P", "-m", "hertzloop", *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=sink,
                text=True,
                start_new_session=True,  # Ctrl-C comes to the launcher, which ends them in order
            )
        child = Child(role, process, stderr)
        self.children.append(child)
        threading.Thread(target=self._listen, args=(child,), daemon=True).start()

    def _listen(self, child: Child) -> None:
        assert child.process.stdout is not None
        for line in child.process.stdout:
            try:
                self._reports.put((child, json.loads(line)))
            except json.JSONDecodeError:
                continue
        child.process.wait()
        self._reports.put((child, {"exited": True}))

    def __enter__(self) -> "Launcher":
        return self

    def __exit__(self, *_: object) -> None:
        self._end_all()
        self._folder.cleanup()

    def wait(self, on_progress: Callable[[int], None] = lambda step: None) -> dict[str, Any]:
        """Wait for the end of the run; the plant's statistics.

        Raises RunFailed with the sentence of whoever failed first for a reason of its own.
        """
        running = {child.role for child in self.children}
        deadline: float | None = None
        while running and (deadline is None or time.monotonic() < deadline):
            try:
                child, report = self._reports.get(timeout=0.2)
            except queue.Empty:
                continue
            if "step" in report:
                on_progress(report["step"])
            child.done = report.get("done", child.done)
            child.fault = report.get("fault", child.fault)
            child.lost_a_peer = report.get("lost_a_peer", child.lost_a_peer)
            if "exited" in report:
                running.discard(child.role)
                if child.process.returncode != 0 and deadline is None:
                    deadline = time.monotonic() + _GRACE_S
        failed = [c for c in self.children if c.role in running or c.process.returncode != 0]
        if failed:
            cause = self._cause(failed, running)
            self._end_all()
            raise RunFailed(cause)
        return next(c.done for c in self.children if c.role == PLANT)

    def _cause(self, failed: list[Child], running: set[str]) -> str:
        """The sentence that explains the failure: a death, a fault, a hang, a lost peer."""
        for child in failed:
            code = child.process.returncode
            if code is not None and code < 0:
                return f"{child.role} was killed by {signal.Signals(-code).name}"
        for child in failed:
            if child.fault and not child.lost_a_peer:
                return child.fault
        for child in failed:
            if child.process.returncode and not child.fault:
                lines = child.stderr.read_text().strip().splitlines() or ["without a word"]
                return f"{child.role} failed with exit code {child.process.returncode}: {lines[-1]}"
        lost = next((c.fault for c in failed if c.fault), "")
        if running:
            return f"{' and '.join(sorted(running))} does not react any more; {lost}"
        return lost

    def _end_all(self) -> None:
        """End the plant first: it tells the others, who then close in order."""
        stages = ((signal.SIGTERM, {PLANT}), (signal.SIGTERM, _ALL), (signal.SIGKILL, _ALL))
        for end, roles in stages:
            alive = [c for c in self.children if c.process.poll() is None]
            for child in alive:
                if child.role in roles:
                    child.process.send_signal(end)
            deadline = time.monotonic() + _PATIENCE_S
            for child in alive:
                try:
                    child.process.wait(max(0.0, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    continue
