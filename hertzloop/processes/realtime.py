"""The real-time profile of a process of a run: what the system grants of it, and a watchdog.

The loops of plant and controller get a real-time scheduling class, so that nothing else delays an
exchange; the recorder works in the usual class, before others, and off the loops' cores where there
are more. Only what it hears is taken in at once, or the plant would wait for room on the bus. What
a loop takes it must not keep: one that spins without progress is put back into the usual class.
"""

import ctypes
import gc
import os
import resource
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from pathlib import Path

from hertzloop.bus.streams import RECORDER

PRIORITY = 50  # of a loop; threads of its bus one above, its watchdog two
_RECORDER_NICE = -10
_LOOPS = 2  # plant and controller
_EVERY_S = 0.25
PATIENCE_S = 1.0  # without progress, at full speed
_LOCK_ALL_ON_FAULT = 1 | 2 | 4  # MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT
_HOW = "allow it with rtprio in /etc/security/limits.conf, or with CAP_SYS_NICE"


class Wanted(StrEnum):
    """auto: where it is permitted and leaves a core to others."""

    AUTO = "auto"
    ON = "on"
    OFF = "off"


class RealtimeProfile:
    """The profile of this process: set before the bus is opened, whose threads inherit it."""

    def __init__(self, wanted: Wanted, role: str) -> None:
        self.granted: list[str] = []
        self.refused: list[str] = []
        self.in_class = False  # real-time
        cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setscheduler") else []
        self._taken = bool(cores) and (
            wanted is Wanted.ON or (wanted is Wanted.AUTO and len(cores) > _LOOPS)
        )
        self._role, self.why_not = role, ""
        if wanted is Wanted.AUTO and not self._taken:
            self.why_not = f"off, because the loops would take all {len(cores)} cores"
        if not self._taken:
            return
        if len(cores) > _LOOPS:
            mine = cores[_LOOPS:] if role == RECORDER else cores[:_LOOPS]
            os.sched_setaffinity(0, mine)
            self.granted.append(f"cores {', '.join(map(str, mine))}")
        self._enter_class()
        if role != RECORDER:
            self._lock_memory()

    def _enter_class(self) -> None:
        try:
            _schedule(0, PRIORITY + 1)
        except (PermissionError, OSError):
            self.refused.append(f"SCHED_FIFO ({_HOW})")
        else:
            self.in_class = True
            recorder = self._role == RECORDER
            self.granted.append("SCHED_FIFO for receiving" if recorder else _loops_class())

    def _lock_memory(self) -> None:
        """Only where there is no limit: at one, memory would run out."""
        limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
        if limit == resource.RLIM_INFINITY or os.geteuid() == 0:
            with suppress(OSError, AttributeError):
                if ctypes.CDLL(None).mlockall(_LOCK_ALL_ON_FAULT) == 0:
                    self.granted.append("memory locked")
                    return
        self.refused.append("locked memory (allow it with memlock in /etc/security/limits.conf)")

    def line(self) -> str:
        """What was granted and what not, and how to get it."""
        if not self._taken:
            return self.why_not or "off"
        words = ", ".join(self.granted) or "nothing granted"
        return words + (f"; not granted: {', '.join(self.refused)}" if self.refused else "")

    @contextmanager
    def loop(self, progress: Callable[[], int]) -> Iterator[None]:
        """Frame of the loop: without garbage collection, and watched while in the class."""
        if not self._taken:
            yield
            return
        if self._role == RECORDER:
            if self.in_class:
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
                os.setpriority(os.PRIO_PROCESS, 0, _RECORDER_NICE)  # of this thread
            yield
            return
        collects = gc.isenabled()
        gc.collect()
        gc.disable()
        over = threading.Event()
        watch: threading.Thread | None = None
        if self.in_class:
            _schedule(0, PRIORITY)  # below the threads of the bus, which inherited one more
            watch = threading.Thread(target=self._watch, args=(progress, over), daemon=True)
            watch.start()
        try:
            yield
        finally:
            over.set()
            if watch is not None:
                watch.join()
                _leave_class()
            if collects:
                gc.enable()

    def _watch(self, progress: Callable[[], int], over: threading.Event) -> None:
        with suppress(OSError):
            _schedule(0, PRIORITY + 2)
        at, cpu_s = progress(), time.process_time()
        while not over.wait(_EVERY_S):
            now, spent_s = progress(), time.process_time()
            if now != at:
                at, cpu_s = now, spent_s
            elif spent_s - cpu_s > PATIENCE_S:
                _leave_class()
                self.in_class = False
                self.granted.append("which was withdrawn: the loop spun without progress")
                return


def _loops_class() -> str:
    """The class of a loop, and how much of the time it has that."""
    with suppress(OSError, ValueError):
        most, period = (
            int(Path(f"/proc/sys/kernel/sched_rt_{what}_us").read_text())
            for what in ("runtime", "period")
        )
        if 0 <= most < period:
            return f"SCHED_FIFO for {most / period:.0%} of a second (sched_rt_runtime_us = {most})"
    return "SCHED_FIFO"


def _schedule(thread: int, priority: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))


def _leave_class() -> None:
    """Put all threads of this process into the usual class."""
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(ProcessLookupError, PermissionError):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
