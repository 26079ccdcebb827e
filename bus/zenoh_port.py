"""Bus between processes: one zenoh peer per role, a full mesh on explicit endpoints.

Why the settings are what they are: a dropped or reordered sample would be a
wrong result, so nothing may be dropped under congestion (BLOCK with a wait that
does not end); multicast scouting and gossip are off, so that only the given
endpoints are open; a liveliness token is declared after the subscribers exist,
so a role that shows up can hear everything.
"""

import json
import os
import queue
import time
from collections.abc import Sequence
from pathlib import Path

import zenoh

from bus.port import BusError, PeerLost
from bus.streams import STREAMS, SUBSCRIPTIONS, Envelope, has_header_sequence

# One runtime thread instead of a pool saves a third of the round trip.
ONE_THREAD_RUNTIME = (
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),"
    "app:(worker_threads:1))"
)
_NEVER_US = 3_600_000_000  # an hour; -1 is documented as "never" but panics
_LEASE_MS = 5_000  # how long a hung peer stays unnoticed


def _config(
    listen: Sequence[str], connect: Sequence[str], config_file: Path | None
) -> zenoh.Config:
    config = zenoh.Config.from_file(str(config_file)) if config_file else zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": _NEVER_US,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 2},
    }
    if listen or not config_file:
        settings["listen/endpoints"] = list(listen)
    if connect or not config_file:
        settings["connect/endpoints"] = list(connect)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class ZenohPort:
    """Port of one role. Raises BusError when an endpoint cannot be opened."""

    def __init__(
        self,
        role: str,
        name: str,
        listen: Sequence[str],
        connect: Sequence[str] = (),
        config_file: Path | None = None,
    ) -> None:
        os.environ.setdefault("ZENOH_RUNTIME", ONE_THREAD_RUNTIME)
        self.role, self.name = role, name
        self._inbox: queue.SimpleQueue[Envelope | PeerLost | KeyboardInterrupt] = (
            queue.SimpleQueue()
        )
        self._interrupted = False
        self._alive: set[str] = set()
        self._watched: set[str] = set()
        self._gone: set[str] = set()
        self._root = f"hertzloop/{name}"
        try:
            self._session = zenoh.open(_config(listen, connect, config_file))
        except zenoh.ZError as error:
            where = ", ".join(listen) or str(config_file)
            in_use = "is the port in use? " if "in use" in str(error) else ""
            why = str(error).split(" at /")[0]
            raise BusError(f"{role} cannot open the bus at {where}: {in_use}{why}") from error
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
            f"{self._root}/alive/*",
            zenoh.handlers.Callback(self._on_liveliness, indirect=False),
            history=True,
        )
        self._token: zenoh.LivelinessToken | None = None

    def _handler(self, stream: str) -> "zenoh.handlers.Callback[zenoh.Sample]":
        put, numbered = self._inbox.put, not has_header_sequence(stream)

        def receive(sample: zenoh.Sample) -> None:
            sequence = None
            if numbered and sample.attachment is not None:
                sequence = int.from_bytes(sample.attachment.to_bytes(), "little")
            put(Envelope(stream, sample.payload.to_bytes(), sequence))

        return zenoh.handlers.Callback(receive, indirect=False)

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        role = str(sample.key_expr).rsplit("/", 1)[1]
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive.add(role)
        else:
            self._alive.discard(role)
            self._gone.add(role)
            self._inbox.put(PeerLost(f"{role} left the run"))

    def announce(self) -> None:
        """Tell the others that this role is ready to hear everything."""
        self._token = self._session.liveliness().declare_token(f"{self._root}/alive/{self.role}")

    def wait_for(self, roles: Sequence[str], timeout_s: float) -> None:
        """Wait until the roles are there. Raises PeerLost naming those that are not."""
        deadline = time.monotonic() + timeout_s
        while missing := [role for role in roles if role not in self._alive]:
            if self._interrupted:
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                raise PeerLost(
                    f"{self.role} waited {timeout_s:g} s for {' and '.join(missing)} on bus "
                    f"'{self.name}': not there"
                )
            time.sleep(0.002)
        self._watched |= set(roles)

    def release(self, role: str) -> None:
        """From now on `role` may leave: it has announced its end."""
        self._watched.discard(role)

    def wait_until_gone(self, role: str, timeout_s: float) -> bool:
        """Wait until a role has left, so that it has surely heard everything."""
        deadline = time.monotonic() + timeout_s
        while role in self._alive and time.monotonic() < deadline:
            time.sleep(0.002)
        return role not in self._alive

    def publish(self, envelope: Envelope) -> None:
        """Send; blocks under congestion. Raises PeerLost if a role of the run has gone."""
        for role in self._gone & self._watched:
            raise PeerLost(f"{role} left the run; {self.role} was sending '{envelope.stream}'")
        attachment = None
        if not has_header_sequence(envelope.stream):
            attachment = (envelope.sequence or 0).to_bytes(8, "little")
        self._publishers[envelope.stream].put(envelope.payload, attachment=attachment)

    def receive(self, timeout_s: float, awaited: str) -> Envelope:
        """Next message; see Port. A role's departure is reported after what it sent."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                item = self._inbox.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise PeerLost(
                    f"{self.role} waited {timeout_s:g} s for {awaited}: nothing came"
                ) from None
            if isinstance(item, Envelope):
                return item
            if isinstance(item, KeyboardInterrupt):
                raise item
            for role in self._gone & self._watched:
                raise PeerLost(f"{role} left the run; {self.role} was waiting for {awaited}")

    def interrupt(self) -> None:
        """Make the next wait raise KeyboardInterrupt; may be called from a signal handler.

        An exception out of the handler itself could fall between a message and its count.
        """
        self._interrupted = True
        self._inbox.put(KeyboardInterrupt())

    def pending(self) -> bool:
        """Whether something is there to receive."""
        return not self._inbox.empty()

    def close(self) -> None:
        """Leave the bus; what was sent is flushed first."""
        self._session.close()
