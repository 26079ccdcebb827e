"""Why a run of several processes has failed: which process is the cause."""

from collections.abc import Iterable

from hertzloop.bus.streams import CONTROLLER, PLANT
from hertzloop.processes.child_process import ChildProcess


def failure_cause(failed: list[ChildProcess], running: set[str], law: str = "") -> str:
    """Return the sentence that explains why a run failed.

    A role that failed for a reason of its own explains it: it was killed, or reports a fault. For
    example, if the controller is killed and plant and recorder report that they lost it, the cause
    is "controller was killed by SIGKILL". If no role has a reason of its own, a role that hangs is
    the cause; at last, one that was lost.

    Args:
        failed: Processes that have failed, in the order of their ends.
        running: Roles that still run.
        law: Name of the law, if it is not a shipped one. It may hang.
    """
    # The user's program exits with a code of its own after it was told of a fault.
    for child in sorted(failed, key=lambda c: (c.program != "", (c.process.returncode or 0) >= 0)):
        if reason := child.own_reason():
            # What a program of the user's says on the bus tells more than how it then exits.
            faults = (one.fault for one in failed if one.role == PLANT and one.others)
            ended_by_it = child.program and not any(one.lost for one in failed)
            return next(faults, reason) if ended_by_it else reason
    missed = {role for child in failed for role in child.lost}
    lost = _most_precise(failed).fault
    if hung := sorted(running & missed):
        hangs = f", perhaps in an endless loop of the law {law}" * bool(law)
        why = hangs if CONTROLLER in hung else ""
        return not_responding(hung, lost, why)
    return lost


def not_responding(roles: Iterable[str], how: str, why: str = "") -> str:
    """Return the sentence on roles that do not respond: how this was noticed, and perhaps why."""
    named = sorted(roles)
    verb = "does" if len(named) == 1 else "do"
    return f"{' and '.join(named)} {verb} not respond{why}; {how}"


def _most_precise(failed: list[ChildProcess]) -> ChildProcess:
    """Return the role that missed the fewest others, of those that missed no role that had timed
    out before, nor one that missed another itself. The first to time out may be the last to end."""
    timed_out: set[str] = set()
    believed: dict[str, ChildProcess] = {}
    for child in sorted(failed, key=lambda child: child.at_s):
        if child.lost and not timed_out & set(child.lost):
            believed[child.role] = child
        if child.lost:
            timed_out.add(child.role)
    last = [child for child in believed.values() if not believed.keys() & set(child.lost)]
    return min(last or believed.values(), key=lambda child: len(child.lost), default=failed[0])
