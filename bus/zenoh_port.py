"""Bus between processes: one zenoh peer per role, a full mesh on explicit endpoints.

A liveliness token is declared after the subscribers exist, so a role that shows up can
hear everything. The settings of a session are in zenoh_config.
"""

import math
import os
import queue
import secrets
import threading
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path

import zenoh

from bus import LEAVING
from bus.compiling import Compiling
from bus.guests import Guests, names_let_in
from bus.port import BusError, PeerLost
from bus.streams import ROLES, STREAMS, SUBSCRIPTIONS, Envelope, has_header_sequence
from bus.zenoh_config import is_known, session_config

# Few runtime threads instead of several pools shorten the round trip. One would be fastest,
# but while zenoh closes the link of a session that hangs, nothing else runs on its thread.
SMALL_RUNTIME = (
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),"
    "app:(worker_threads:2))"
)
_CLOSE_S = 2.0  # for zenoh to send what is under way
_NOTICE_S = 4.0  # for zenoh to say whose link it has closed
# For last words that say why a role has left: they come over the link of another, perhaps later.
_EXPLAIN_S = 0.5


class ZenohPort:
    """Port of one role. Raises BusError when an endpoint cannot be opened.

    `patience_s` is how long a role of the run may leave messages untaken; `say` is told who is
    linked in vain, where a configuration file decides who is let in.
    """

    def __init__(
        self,
        role: str,
        name: str,
        listen: Sequence[str],
        connect: Sequence[str] = (),
        config_file: Path | None = None,
        patience_s: float = 5.0,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        os.environ.setdefault("ZENOH_RUNTIME", SMALL_RUNTIME)
        self.role, self.name = role, name
        self._first: Envelope | PeerLost | KeyboardInterrupt | None = None  # out of the inbox
        self._inbox: queue.SimpleQueue[Envelope | PeerLost | KeyboardInterrupt] = (
            queue.SimpleQueue()
        )
        self._interrupted = False
        self._instance = secrets.token_hex(8)  # two processes of one role have two tokens
        self._alive: dict[str, set[str]] = {r: set() for r in ROLES}  # instances
        self._watched: dict[str, str] = {}  # the instance that takes part in the run
        self._left_s: dict[str, float] = {}  # roles of which some process has left, and when
        self._vouched: set[str] = set()
        self._spoke_last: set[str] = set()  # roles that announced their end: they are not deaf
        self._patience_s = patience_s
        self._root = f"hertzloop/{name}"
        try:
            config = session_config(role, ROLES, name, listen, connect, config_file, patience_s)
            let_in = names_let_in(config)
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            where = ", ".join(listen) or str(config_file)
            in_use = "is the port in use? " if "in use" in str(error) else ""
            why = str(error).split(" at /")[0]
            raise BusError(f"{role} cannot open the bus at {where}: {in_use}{why}") from error
        self._guests: Guests | None = None
        if config_file:
            self._guests = Guests(self._session, let_in, config_file, name, role, say)
        self._publishers = {
            stream.name: self._session.declare_publisher(
                f"{self._root}/{stream.name}",
                congestion_control=zenoh.CongestionControl.BLOCK,
                reliability=zenoh.Reliability.RELIABLE,
                express=True,
            )
            for stream in STREAMS.values()
            if stream.publisher == role
        }
        self._subscribers = [
            self._session.declare_subscriber(f"{self._root}/{stream}", self._handler(stream))
            for stream in SUBSCRIPTIONS[role]
        ]
        self._watch = self._session.liveliness().declare_subscriber(
            f"{self._root}/alive/*/*",
            zenoh.handlers.Callback(self._on_liveliness, indirect=False),
            history=True,
        )
        self._vouchers = self._session.liveliness().declare_subscriber(
            f"{self._root}/complete/*",
            zenoh.handlers.Callback(self._on_voucher, indirect=False),
            history=True,
        )
        self._tokens: list[zenoh.LivelinessToken] = []
        self._compiling = Compiling(self._session, self._root, role, self._instance)
        self.compiling = self._compiling.tell

    def _handler(self, stream: str) -> "zenoh.handlers.Callback[zenoh.Sample]":
        put, numbered = self._inbox.put, not has_header_sequence(stream)

        def receive(sample: zenoh.Sample) -> None:
            sequence = None
            if numbered and sample.attachment is not None:
                number = sample.attachment.to_bytes()
                sequence = int.from_bytes(number, "little") if len(number) == 8 else None
            put(Envelope(stream, sample.payload.to_bytes(), sequence))
            if stream.startswith("end/"):
                self._spoke_last.add(stream.removeprefix("end/"))

        return zenoh.handlers.Callback(receive, indirect=False)

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        role, instance = str(sample.key_expr).rsplit("/", 2)[1:]
        if role not in self._alive:
            return
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive[role].add(instance)
        else:
            self._left_s[role] = time.monotonic()  # first: who is not alive has a time
            self._alive[role].discard(instance)
            self._inbox.put(PeerLost(f"{role} left the run", role))

    def _on_voucher(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._vouched.add(str(sample.key_expr).rsplit("/", 1)[1])

    def _declare(self, what: str) -> None:
        token = self._session.liveliness().declare_token(f"{self._root}/{what}")
        self._tokens.append(token)

    def _gone(self) -> list[str]:
        """Roles of the run that left it without a word. Who announced an end has said why: that
        message is received before anything is missed. Who vouched for its part has heard all of
        the others, whose last words may still be on their way to this one. So may be those of
        who is still there: for a moment nobody is missed."""
        if not self._left_s:
            return []
        said, watched = self._spoke_last | self._vouched, list(self._watched.items())
        lost = [role for role, one in watched if one not in self._alive[role] and role not in said]
        to_say = self._watched.keys() - said - {*lost}
        before_s = time.monotonic() - (_EXPLAIN_S if to_say else 0.0)
        return [role for role in lost if self._left_s[role] <= before_s]

    def _refuse_doubles(self) -> None:
        for role, instances in self._alive.items():
            count = len(instances | {self._instance}) if role == self.role else len(instances)
            if count > 1:
                raise BusError(
                    f"{count} processes are the {role} on bus '{self.name}', a run has one: end "
                    "the others, or give each run a name of its own (--name)"
                )

    def announce(self) -> None:
        """Tell the others that this role is ready to hear everything."""
        self._declare(f"alive/{self.role}/{self._instance}")

    def vouch(self) -> None:
        """Tell the others that this role has done its part of the run, without a fault."""
        self._declare(f"complete/{self.role}")

    def wait_for(self, roles: Sequence[str], timeout_s: float) -> None:
        """Wait until the roles are there. Raises PeerLost naming those that are not, BusError
        when a role is there twice.

        A role that left while others were awaited may come again.
        """
        deadline = time.monotonic() + timeout_s
        while missing := [role for role in roles if not self._alive[role]]:
            self._refuse_doubles()
            if self._interrupted:
                raise KeyboardInterrupt
            if self._guests:
                self._guests.missing(missing)
            deadline = self._compiling.extended(deadline, timeout_s, lambda one, _: one in missing)
            if time.monotonic() > deadline:
                left = [role for role in missing if role in self._left_s]
                again = f" ({' and '.join(left)} came, but left again)" if left else ""
                again += self._guests.words() if self._guests else ""
                again += self._compiling.words()
                raise PeerLost(
                    f"{self.role} waited {timeout_s:g} s for {' and '.join(missing)} on bus "
                    f"'{self.name}': not there{again}",
                    *missing,
                )
            time.sleep(0.002)
        self._refuse_doubles()
        # One that left at this very moment stays watched as "", which is never alive.
        self._watched |= {role: next(iter(tuple(self._alive[role])), "") for role in roles}

    def strangers(self) -> list[str]:
        """Ids of the sessions linked to this one that are no role's: what they do not take in time
        is dropped."""
        linked = [str(number) for number in self._session.info.peers_zid()]
        return [number for number in linked if not is_known(self.name, tuple(self._alive), number)]

    def release(self, role: str) -> None:
        """From now on `role` may leave: it has announced its end."""
        self._watched.pop(role, None)

    def wait_until_gone(self, role: str, timeout_s: float) -> bool:
        """Wait until a role has left, so that it has surely heard everything; whether it has. Of a
        role of the run, the process that takes part counts, whoever else says to be that role.
        Raises KeyboardInterrupt when interrupted."""
        deadline = time.monotonic() + timeout_s
        one = self._watched.get(role)
        while there := bool(self._alive[role]) if one is None else one in self._alive[role]:
            if self._interrupted:
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                break
            time.sleep(0.002)
        return not there

    def wait_until_heard(self, timeout_s: float, besides: Collection[str] = ()) -> None:
        """Wait until the last words of this role have reached all: each of the others has left, or
        has announced an end of its own, or is one that nobody waits for (`besides`)."""
        deadline = time.monotonic() + timeout_s

        def listening() -> bool:
            known = {self.role, *besides, *tuple(self._spoke_last)}
            return any(alive for role, alive in self._alive.items() if role not in known)

        while listening() and time.monotonic() < deadline:
            time.sleep(0.002)

    def wait_for_voucher(self, role: str, timeout_s: float) -> None:
        """Wait until a role has left. Raises PeerLost unless it vouched for its part before."""
        how = "left the run before its part was complete"
        if not self.wait_until_gone(role, timeout_s):
            how = f"did not complete its part within {timeout_s:.0f} s"
        if role not in self._vouched:
            raise PeerLost(f"{role} {how}", role)

    def publish(self, envelope: Envelope) -> None:
        """Send; blocks under congestion. Raises PeerLost if a role of the run has gone, or does
        not take its messages within the patience. Last words are sent to whoever is left."""
        for role in [] if envelope.stream.startswith("end/") else self._gone():
            raise PeerLost(
                f"{role} left the run; {self.role} was sending '{envelope.stream}'", role
            )
        attachment = None
        if not has_header_sequence(envelope.stream):
            attachment = (envelope.sequence or 0).to_bytes(8, "little")
        started = time.monotonic()
        self._publishers[envelope.stream].put(envelope.payload, attachment=attachment)
        if time.monotonic() - started >= self._patience_s:
            self._blame(envelope.stream)

    def _blame(self, stream: str) -> None:
        """Name who did not take a message. Raises PeerLost: zenoh has given the message up."""
        deadline = time.monotonic() + _NOTICE_S
        while not (deaf := set(self._gone())) and time.monotonic() < deadline:
            time.sleep(0.002)
        named = sorted(deaf or self._watched.keys() - self._spoke_last or self._watched)
        raise PeerLost(
            f"{' or '.join(named)} took no message for {self._patience_s:g} s; {self.role} was "
            f"sending '{stream}'",
            *named,
        )

    def receive(self, timeout_s: float, awaited: str) -> Envelope:
        """Next message; see Port. A role's departure is reported after what it sent."""
        deadline = time.monotonic() + timeout_s
        while True:
            wait_s = max(0.0, deadline - time.monotonic())
            try:
                item = self._first or self._inbox.get(timeout=min(wait_s, self._look_again_s()))
                self._first = None
            except queue.Empty:
                self._miss(awaited)
                deadline = self._compiling.extended(deadline, timeout_s, self._takes_part)
                if time.monotonic() < deadline:
                    continue
                raise PeerLost(
                    f"{self.role} waited {timeout_s:g} s for {awaited}: nothing came"
                    f"{self._compiling.words()}",
                    *self._awaited(awaited),
                ) from None
            if isinstance(item, Envelope):
                return item
            if isinstance(item, KeyboardInterrupt):
                raise item
            self._miss(awaited)

    def _look_again_s(self) -> float:
        """How long a wait may last before somebody could be missed: without end as long as all are
        there, since who leaves ends the wait."""
        if not self._left_s:
            return math.inf
        return 0.0 if self._gone() else _EXPLAIN_S

    def _miss(self, awaited: str) -> None:
        for role in self._gone():
            raise PeerLost(f"{role} left the run; {self.role} was waiting for {awaited}", role)

    def _takes_part(self, role: str, instance: str) -> bool:
        return self._watched.get(role) == instance

    def _awaited(self, awaited: str) -> list[str]:
        return [role for role in self._watched if role in awaited.split()]

    def interrupt(self) -> None:
        """Make the next wait raise KeyboardInterrupt; may be called from a signal handler.

        An exception out of the handler itself could fall between a message and its count.
        """
        self._interrupted = True
        self._inbox.put(KeyboardInterrupt())

    def pending(self) -> bool:
        """Whether `receive` has something to give, or to raise, at once. That a role has left which
        may leave is neither: who then waited for a message could wait in vain."""
        while self._first is None:
            try:
                item = self._inbox.get_nowait()
            except queue.Empty:
                return bool(self._gone())
            if not isinstance(item, PeerLost):
                self._first = item
        return True

    def close(self) -> None:
        """Leave the bus; what was sent is flushed first, as far as the others take it.

        A peer that hangs can make zenoh wait or fail here; whether all arrived, the announced
        counts tell.
        """

        def leave() -> None:
            with suppress(zenoh.ZError):
                self._session.close()

        leaving = threading.Thread(target=leave, name=LEAVING, daemon=True)
        leaving.start()
        leaving.join(_CLOSE_S)
