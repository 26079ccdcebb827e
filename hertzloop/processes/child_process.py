"""A process of a run, as its launcher sees it."""

from dataclasses import dataclass, field
from pathlib import Path
from signal import Signals
from typing import Any

from hertzloop.processes import fork_server
from hertzloop.processes.signals import INTERRUPTED


@dataclass
class ChildProcess:
    """A process of a run, and what it has reported.

    Attributes:
        role: Its role in the run.
        process: The process.
        stderr: File with its standard error.
        program: Its command line, if it is the user's own. It then reports nothing but its end.
        ready: Whether it takes part in the run.
        fault: Why it has failed, in a sentence.
        others: Whether the fault is that of another role.
        lost: Roles that it has lost.
        at_s: When it noticed that it had lost them.
        done: Its result, once it has done its part.
    """

    role: str
    process: fork_server.Role
    stderr: Path
    program: str = ""
    ready: bool = False
    fault: str = ""
    others: bool = False
    lost: list[str] = field(default_factory=list)
    at_s: float = 0.0
    done: dict[str, Any] = field(default_factory=dict)

    def own_reason(self) -> str:
        """Return why it failed, if for a reason of its own; "" if another role was the reason."""
        code = self.process.returncode
        assert code is not None  # it has ended
        if self.fault and code >= 0:
            return "" if self.others else self.fault
        if how := exit_reason(code):
            return f"{self.named} {how}"
        lines = self.stderr.read_text(errors="replace").strip().splitlines() or ["no message"]
        return f"{self.named} failed with exit code {code}: {lines[-1]}"

    @property
    def named(self) -> str:
        """The role, with its command line if that is the user's own."""
        return f"{self.role} ('{self.program}')" if self.program else self.role


def exit_reason(code: int) -> str:
    """Return how a signal ended a process, by its exit code; "" if none did."""
    if code < 0:
        return f"was killed by {Signals(-code).name}"
    return "was interrupted" if code == INTERRUPTED else ""
