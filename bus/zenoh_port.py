"""Bus between processes: one zenoh peer per role, a full mesh on explicit endpoints.

The settings of a session are in zenoh_config, the liveliness of the roles in liveliness.
"""

import os
import queue
import threading
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

import zenoh

from hertzloop.bus import LEAVING
from hertzloop.bus.liveliness import Liveliness
from hertzloop.bus.port import BusError, PeerLost
from hertzloop.bus.streams import STREAMS, SUBSCRIPTIONS, Envelope
from hertzloop.bus.zenoh_config import session_config

# Few runtime threads instead of several pools shorten the round trip. One would be fastest,
# but while zenoh closes the link of a session that hangs, nothing else runs on its thread.
SMALL_RUNTIME = (
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),"
    "app:(worker_threads:2))"
)
_CLOSE_S = 2.0  # for zenoh to send what is under way
# A larger message is sent in pieces that wait for one another, for some ms in all: the loop goes on
# meanwhile. Not more bytes of such messages wait than that.
_AT_ONCE_BYTES, _WAITING_BYTES = 1 << 12, 4 << 20


def _why(error: zenoh.ZError) -> str:
    """Return why a session cannot be opened, and what to do."""
    text = str(error)
    if "Address already in use" in text:
        return "the port is in use. Choose another one, or end the program that uses it."
    if "Cannot assign requested address" in text:
        return "this computer does not have the address. Listen on one that it has."
    if "Permission denied" in text:
        return "the system does not permit it. Choose a port above 1023."
    return text.split(" at /")[0]


class ZenohPort:
    """Port of one role. Raises BusError when an endpoint cannot be opened.

    `timeout_s` is how long a subscriber may leave a message untaken. `liveliness` tells which roles
    are there.
    """

    def __init__(
        self,
        role: str,
        name: str,
        listen: Sequence[str],
        connect: Sequence[str] = (),
        config_file: Path | None = None,
        timeout_s: float = 5.0,
    ) -> None:
        os.environ.setdefault("ZENOH_RUNTIME", SMALL_RUNTIME)
        self.role, self.name = role, name
        self._first: Envelope | BaseException | None = None  # out of the inbox
        self._inbox: queue.SimpleQueue[Envelope | BaseException] = queue.SimpleQueue()
        self._timeout_s = timeout_s
        self._root = f"hertzloop/{name}"
        try:
            config = session_config(listen, connect, config_file, timeout_s)
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            where = ", ".join(listen) or str(config_file)
            raise BusError(f"{role} cannot open the bus at {where}: {_why(error)}") from error
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
        self._outbox: queue.SimpleQueue[Envelope | None] = queue.SimpleQueue()
        self._waiting = 0  # bytes of what is in it, or on its way out of it
        self._sent = threading.Condition()
        self._not_sent: BaseException | None = None  # why a message out of it could not be
        self._sender = threading.Thread(target=self._send, name="sending", daemon=True)
        # Declared before any message can come, which it notes the end of a role from.
        self.liveliness = Liveliness(self._session, name, role, self._inbox.put)
        self._subscribers = [
            self._session.declare_subscriber(f"{self._root}/{stream}", self._handler(stream))
            for stream in SUBSCRIPTIONS[role]
        ]
        self._sender.start()

    def _handler(self, stream: str) -> "zenoh.handlers.Callback[zenoh.Sample]":
        put, once = self._inbox.put, STREAMS[stream].once

        def receive(sample: zenoh.Sample) -> None:
            sequence = 0 if once else None
            if sample.attachment is not None:
                number = sample.attachment.to_bytes()
                sequence = int.from_bytes(number, "little") if len(number) == 8 else None
            put(Envelope(stream, sample.payload.to_bytes(), sequence))
            if stream.startswith("end/"):
                self.liveliness.note_end(stream.removeprefix("end/"))

        return zenoh.handlers.Callback(receive, indirect=False)

    def publish(self, envelope: Envelope) -> None:
        """Send, in the order of the calls; a large message in a thread of its own. Blocks while too
        much waits to be sent. Raises PeerLost if a role of the run has gone, BusError if a
        subscriber did not take its messages within the timeout. A final message is sent to whoever
        is left."""
        size, final = len(envelope.payload), envelope.stream.startswith("end/")
        with self._sent:
            while self._waiting > (0 if final else _WAITING_BYTES) and self._not_sent is None:
                self._sent.wait()
            if not final:
                self._check(f"sending '{envelope.stream}'")
            at_once = not self._waiting and (final or size <= _AT_ONCE_BYTES)
            if not at_once:
                self._waiting += size
                self._outbox.put(envelope)
        if at_once:
            self._put(envelope)

    def _send(self) -> None:
        """Send what is in the outbox, until that is closed; after a message that was not taken the
        final message alone, since each would wait as long again."""
        while (envelope := self._outbox.get()) is not None:
            try:
                if self._not_sent is None or envelope.stream.startswith("end/"):
                    self._put(envelope)
            except Exception as error:  # whatever it is: others wait until all is sent
                self._not_sent = error
                self._inbox.put(error)
            with self._sent:
                self._waiting -= len(envelope.payload)
                self._sent.notify()

    def _put(self, envelope: Envelope) -> None:
        attachment, stream = None, STREAMS[envelope.stream]
        if not stream.once and not stream.numbered:
            attachment = (envelope.sequence or 0).to_bytes(8, "little")
        started = time.monotonic()
        self._publishers[envelope.stream].put(envelope.payload, attachment=attachment)
        if time.monotonic() - started >= self._timeout_s:
            raise self.liveliness.not_taken(envelope.stream, self._timeout_s)

    def _check(self, doing: str) -> None:
        """Raise what went wrong with a message sent before, or PeerLost if a role has gone."""
        if self._not_sent is not None:
            raise self._not_sent
        self.liveliness.check(doing)

    def _check_all_sent(self) -> None:
        """Wait until all is sent, and raise what went wrong with that. Who does not take a message
        is the cause of what the others miss, and is known last: at the end of the timeout."""
        with self._sent:
            while self._waiting:
                self._sent.wait()
        if self._not_sent is not None:
            raise self._not_sent

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        """Next message; see Port. A role's departure is reported after what it sent."""
        now = time.monotonic()
        deadline = now + timeout_s
        while True:
            wait_s = max(0.0, deadline - now)
            try:
                item = self._first or self._inbox.get(
                    timeout=min(wait_s, self.liveliness.look_again_s())
                )
                self._first = None
            except queue.Empty:
                self._check(f"waiting for {awaited}")
                now = time.monotonic()
                if now < deadline:
                    continue
                self._check_all_sent()
                raise self.liveliness.nothing_came(timeout_s, awaited, senders) from None
            if isinstance(item, Envelope):
                if item.stream.startswith("end/"):
                    self._check_all_sent()
                return item
            if not isinstance(item, PeerLost):
                raise item
            self._check(f"waiting for {awaited}")
            now = time.monotonic()

    def abort(self, error: BaseException) -> None:
        """Make the next wait raise `error`; may be called from a signal handler."""
        self.liveliness.abort(error)
        self._inbox.put(error)

    def pending(self) -> bool:
        """Whether `receive` has something to give, or to raise, at once. That a role has left which
        may leave is neither: who then waited for a message could wait in vain."""
        while self._first is None:
            try:
                item = self._inbox.get_nowait()
            except queue.Empty:
                return self._not_sent is not None or bool(self.liveliness.missing())
            if not isinstance(item, PeerLost):
                self._first = item
        return True

    def close(self) -> None:
        """Leave the bus; what was sent is flushed first, as far as the others take it.

        A peer that hangs can make zenoh wait or fail here; whether all arrived, the announced
        counts tell.
        """

        def leave() -> None:
            self._outbox.put(None)
            self._sender.join()
            with suppress(zenoh.ZError):
                self.liveliness.leave()
            with suppress(zenoh.ZError):
                self._session.close()

        leaving = threading.Thread(target=leave, name=LEAVING, daemon=True)
        leaving.start()
        leaving.join(_CLOSE_S)
