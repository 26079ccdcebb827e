"""The roles of a run on the bus: who is there, who has left, who is to blame when a wait fails.

A role tells the others by liveliness tokens. It declares one after its subscribers exist, so a role
that shows up can hear everything, and another one once its part of the run is complete.
"""

import math
import secrets
import time
from collections.abc import Callable, Collection, Sequence

import zenoh

from hertzloop.bus.port import BusError, PeerLost
from hertzloop.bus.streams import RECORDER, ROLES, SUBSCRIPTIONS

# For a final message that says why a role has left: it comes over the link of another role, perhaps
# later.
_EXPLAIN_S = 0.5
_LOOK_S = 0.002


class Liveliness:
    """What one role knows of the presence of the others, and tells them of its own.

    Args:
        session: of this role.
        name: of the run.
        role: this one.
        on_left: told when a process of any role has left.
    """

    def __init__(
        self,
        session: zenoh.Session,
        name: str,
        role: str,
        on_left: Callable[[PeerLost], None],
    ) -> None:
        self.role, self.name = role, name
        self.alive: dict[str, set[str]] = {r: set() for r in ROLES}  # instances
        self._living, self._root = session.liveliness(), f"hertzloop/{name}"
        self._on_left = on_left
        self._instance = secrets.token_hex(8)  # two processes of one role have two tokens
        self._watched: dict[str, str] = {}  # the instance that takes part in the run
        self._left_s: dict[str, float] = {}  # roles of which some process has left, and when
        self._complete: set[str] = set()
        self._ended: set[str] = set()  # roles that announced their end: they are not deaf
        self._aborted: BaseException | None = None
        self._subscribers = [
            self._living.declare_subscriber(
                f"{self._root}/{key}",
                zenoh.handlers.Callback(handler, indirect=False),
                history=True,
            )
            for key, handler in (("alive/*/*", self._on_life), ("complete/*", self._on_complete))
        ]
        self._tokens: list[zenoh.LivelinessToken] = []

    def _on_life(self, sample: zenoh.Sample) -> None:
        role, instance = str(sample.key_expr).rsplit("/", 2)[1:]
        if role not in self.alive:
            return
        if sample.kind == zenoh.SampleKind.PUT:
            self.alive[role].add(instance)
        else:
            self._left_s[role] = time.monotonic()  # first: who is not alive has a time
            self.alive[role].discard(instance)
            self._on_left(PeerLost(f"{role} left the run", role))

    def _on_complete(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._complete.add(str(sample.key_expr).rsplit("/", 1)[1])

    def _declare(self, what: str) -> None:
        self._tokens.append(self._living.declare_token(f"{self._root}/{what}"))

    def announce(self) -> None:
        """Tell the others that this role is ready to hear everything."""
        self._declare(f"alive/{self.role}/{self._instance}")

    def confirm_completion(self) -> None:
        """Tell the others that this role has done its part of the run, without a fault."""
        self._declare(f"complete/{self.role}")

    def leave(self) -> None:
        """Take the tokens back: not every client is told of those that go with a session."""
        for token in self._tokens:
            token.undeclare()
        self._tokens.clear()

    def abort(self, error: BaseException) -> None:
        """Make every wait from now on raise `error`."""
        self._aborted = error

    def note_end(self, role: str) -> None:
        """Note that a role has announced its end."""
        self._ended.add(role)

    def release(self, role: str) -> None:
        """From now on `role` may leave: it has announced its end."""
        self._watched.pop(role, None)

    def missing(self) -> list[str]:
        """Roles of the run that left it without a word.

        A role that announced its end has said why. zenoh sends tokens before messages that wait,
        and each link has its own pace. So the final message may come after its role has left: for a
        moment nobody is missed while another role could still say why. Once the recorder has
        confirmed its completion nobody is missed: it has heard all final messages. If the
        controller is killed, plant and recorder each wait `_EXPLAIN_S` for a word of the other.
        """
        if not self._left_s or RECORDER in self._complete:
            return []
        lost = self._gone()
        to_report = self._watched.keys() - self._ended - {*lost}
        before_s = time.monotonic() - (_EXPLAIN_S if to_report else 0.0)
        return [role for role in lost if self._left_s[role] <= before_s]

    def _gone(self) -> list[str]:
        """Return the roles of the run that are not there and did not announce their end."""
        watched = list(self._watched.items())
        gone = [role for role, one in watched if one not in self.alive[role]]
        return [role for role in gone if role not in self._ended]

    def look_again_s(self) -> float:
        """How long a wait may last before a role could be missed: without end as long as all are
        there, since a role that leaves ends the wait."""
        if not self._left_s:
            return math.inf
        return 0.0 if self.missing() else _EXPLAIN_S

    def check(self, doing: str) -> None:
        """Raise PeerLost if a role of the run has left it; `doing` says what this one was doing."""
        for role in self.missing():
            raise PeerLost(f"{role} left the run; {self.role} was {doing}", role)

    def nothing_came(self, timeout_s: float, awaited: str, senders: Collection[str]) -> PeerLost:
        """The error of a wait for a message of `senders` that has timed out."""
        return PeerLost(
            f"{self.role} waited {timeout_s:g} s for {awaited}: nothing came",
            *(role for role in self._watched if role in senders),
        )

    def not_taken(self, stream: str, timeout_s: float) -> PeerLost:
        """The error of a message that zenoh has given up: it names who may not have accepted it.
        zenoh does not say whose link it is about to close, if that is the link of a process that
        hangs."""
        if deaf := sorted(self._gone()):
            named = " and ".join(deaf)
        else:
            hearing = self._watched.keys() - self._ended
            deaf = sorted(role for role in hearing if stream in SUBSCRIPTIONS[role])
            named = " or ".join([*deaf, "an observer"])
        return PeerLost(
            f"{named} accepted no message for {timeout_s:g} s; {self.role} was sending '{stream}'",
            *deaf,
        )

    def _refuse_doubles(self) -> None:
        for role, instances in self.alive.items():
            count = len(instances | {self._instance}) if role == self.role else len(instances)
            if count > 1:
                raise BusError(
                    f"{count} processes are the {role} on bus '{self.name}'; a run has one. End "
                    "the others, or give each run its own name (--name)"
                )

    def wait_for(self, roles: Sequence[str], timeout_s: float) -> None:
        """Wait until the roles are there. Raises PeerLost naming those that are not, BusError
        when a role is there twice.

        A role that left while others were awaited may come again.
        """
        deadline = time.monotonic() + timeout_s
        while absent := [role for role in roles if not self.alive[role]]:
            self._refuse_doubles()
            if self._aborted:
                raise self._aborted
            if time.monotonic() > deadline:
                left = [role for role in absent if role in self._left_s]
                again = f" ({' and '.join(left)} appeared, but exited again)" if left else ""
                raise PeerLost(
                    f"{self.role} waited {timeout_s:g} s for {' and '.join(absent)} on bus "
                    f"'{self.name}': not there{again}",
                    *absent,
                )
            time.sleep(_LOOK_S)
        self._refuse_doubles()
        # One that left at this very moment stays watched as "", which is never alive.
        self._watched |= {role: next(iter(tuple(self.alive[role])), "") for role in roles}

    def wait_until_gone(self, role: str, timeout_s: float) -> bool:
        """Wait until a role has left, so that it has surely heard everything; whether it has. Of a
        role of the run, the process that takes part counts, whoever else says to be that role.
        Raises what `abort` was given."""
        deadline = time.monotonic() + timeout_s
        one = self._watched.get(role)
        while there := bool(self.alive[role]) if one is None else one in self.alive[role]:
            if self._aborted:
                raise self._aborted
            if time.monotonic() > deadline:
                break
            time.sleep(_LOOK_S)
        return not there

    def wait_until_heard(self, timeout_s: float, besides: Collection[str] = ()) -> None:
        """Wait until the final message of this role has reached all: each of the others has left,
        or has announced an end of its own, or is one that nobody waits for (`besides`)."""
        deadline = time.monotonic() + timeout_s

        def listening() -> bool:
            known = {self.role, *besides, *tuple(self._ended)}
            return any(alive for role, alive in self.alive.items() if role not in known)

        while listening() and time.monotonic() < deadline:
            time.sleep(_LOOK_S)

    def wait_for_completion(self, role: str, timeout_s: float) -> None:
        """Wait until a role has left. Raises PeerLost unless it confirmed its completion before."""
        how = "left the run before its part was complete"
        if not self.wait_until_gone(role, timeout_s):
            how = f"did not complete its part within {timeout_s:.0f} s"
        if role not in self._complete:
            raise PeerLost(f"{role} {how}", role)
