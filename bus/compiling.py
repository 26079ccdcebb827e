"""Which processes of a run compile at the moment: whoever waits for them waits longer.

A process says so by a liveliness token, which goes with the process if it dies.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import zenoh

from hertzloop.bus.process_clock import clock

LONGEST_S = 300.0  # to compile one kernel, many times what it takes on a busy machine


@dataclass
class _Compiling:
    since_s: float
    until_s: float | None = None  # None: it still compiles

    @property
    def overdue(self) -> bool:
        return self.until_s is None and clock.now() - self.since_s > LONGEST_S


class Compiling:
    """Tells the others of this process's compilations (`tell`), and hears of theirs."""

    def __init__(self, session: zenoh.Session, root: str, role: str, instance: str) -> None:
        self._living, self._key = session.liveliness(), f"{root}/compiling/{role}/{instance}"
        self._token: zenoh.LivelinessToken | None = None
        self._seen: dict[tuple[str, str], _Compiling] = {}  # by role and instance, the latest
        self._kept = self._living.declare_subscriber(
            f"{root}/compiling/*/*",
            zenoh.handlers.Callback(self._on_token, indirect=False),
            history=True,
        )

    def _on_token(self, sample: zenoh.Sample) -> None:
        role, instance = str(sample.key_expr).rsplit("/", 2)[1:]
        now = clock.now()
        if sample.kind == zenoh.SampleKind.PUT:
            self._seen[role, instance] = _Compiling(now)
        elif one := self._seen.get((role, instance)):
            one.until_s = now

    def tell(self, begins: bool) -> None:
        """Tell the others that this process begins to compile a kernel, or is done with it."""
        with suppress(zenoh.ZError):  # the session is closed
            if begins:
                self._token = self._living.declare_token(self._key)
            elif self._token is not None:
                self._token.undeclare()
                self._token = None

    def extended(
        self, deadline_s: float, timeout_s: float, awaited: Callable[[str, str], bool]
    ) -> float:
        """When to give up a wait that was to end at `deadline_s`: not before `timeout_s` after the
        end of a compilation of an `awaited` process (role, instance)."""
        now = clock.now()
        for one, found in list(self._seen.items()):
            if awaited(*one) and not found.overdue:
                deadline_s = max(deadline_s, (found.until_s or now) + timeout_s)
        return deadline_s

    def words(self) -> str:
        """To end a sentence with: who has compiled for too long; "" if nobody has."""
        overdue = [role for (role, _), found in list(self._seen.items()) if found.overdue]
        return "".join(
            f"; the {role} has been compiling one kernel for more than {LONGEST_S:g} s"
            for role in overdue
        )
