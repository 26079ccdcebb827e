"""The real-time profile of a process of a run: its scheduling class and its cores.

The loops of plant and controller get a real-time class, so that nothing else delays an exchange.
The recorder works in the usual class, before others, and off the loops' cores where there are more.
Only what it hears is taken in at once, or the plant would wait for room on the bus.
"""

import gc
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from hertzloop.bus.streams import RECORDER

PRIORITY = 50  # of a loop; threads of its bus one above
_RECORDER_NICE = -10
_LOOPS = 2  # plant and controller
_MORE_THAN = {"off": math.inf, "auto": _LOOPS, "on": 0}  # cores, for the profile to be taken


class RealtimeProfile:
    """The profile of this process: set before the bus is opened, whose threads inherit it.

    Attributes:
        line: What was granted and what not, and how to get it.
    """

    def __init__(self, wanted: Literal["auto", "on", "off"], role: str) -> None:
        """`wanted`: auto takes it where it leaves a core to others."""
        self._role, self._in_class, self.line = role, False, "off"
        cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setscheduler") else []
        self._taken = len(cores) > _MORE_THAN[wanted]
        if wanted == "auto" and not self._taken:
            self.line = f"off, because the loops would take all {len(cores)} cores"
        if not self._taken:
            return
        said = []
        if len(cores) > _LOOPS:
            mine = cores[_LOOPS:] if role == RECORDER else cores[:_LOOPS]
            os.sched_setaffinity(0, mine)
            said.append(f"cores {', '.join(map(str, mine))}")
        try:
            _schedule(os.SCHED_FIFO, PRIORITY + 1)
        except OSError:
            said.append(
                "no SCHED_FIFO (allow it with rtprio in /etc/security/limits.conf, or with "
                "CAP_SYS_NICE)"
            )
        else:
            self._in_class = True
            said.append("SCHED_FIFO for receiving" if role == RECORDER else "SCHED_FIFO")
        self.line = ", ".join(said)

    @contextmanager
    def loop(self) -> Iterator[None]:
        """Frame of the loop, which runs without garbage collection."""
        if self._role == RECORDER:
            if self._in_class:
                _schedule(os.SCHED_OTHER, 0)
                os.setpriority(os.PRIO_PROCESS, 0, _RECORDER_NICE)  # of this thread
            yield
            return
        collects = self._taken and gc.isenabled()
        if collects:
            gc.collect()
            gc.disable()
        if self._in_class:
            _schedule(os.SCHED_FIFO, PRIORITY)
        try:
            yield
        finally:
            if self._in_class:
                _schedule(os.SCHED_OTHER, 0)
            if collects:
                gc.enable()


def _schedule(policy: int, priority: int) -> None:
    os.sched_setscheduler(0, policy, os.sched_param(priority))
