"""Bus inside one process: publishing calls the subscribers, in order, in this thread."""

from collections import deque
from collections.abc import Callable, Collection

from bus.port import PeerLost
from bus.streams import SUBSCRIPTIONS, Envelope

Handler = Callable[[Envelope], None]


class InProcessBus:
    """Delivers every message to the roles that hear its stream before `publish` returns.

    A message published while another is being delivered waits its turn, so all
    subscribers see all streams in one order.
    """

    def __init__(self) -> None:
        self._handlers: list[tuple[str, Handler]] = []
        self._waiting: deque[Envelope] = deque()
        self._delivering = False

    def attach(self, role: str, handler: Handler) -> None:
        """Let `handler` see every message of the streams that `role` hears."""
        self._handlers.append((role, handler))

    def deliver(self, envelope: Envelope) -> None:
        """Hand a message to all who hear it."""
        self._waiting.append(envelope)
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                item = self._waiting.popleft()
                for role, handler in self._handlers:
                    if item.stream in SUBSCRIPTIONS[role]:
                        handler(item)
        finally:
            self._delivering = False


class InProcessPort:
    """Port of one role on an InProcessBus; collects what came until it is received."""

    def __init__(self, bus: InProcessBus, role: str, handler: Handler | None = None) -> None:
        self.role = role
        self._bus = bus
        self._inbox: deque[Envelope] = deque()
        bus.attach(role, handler or self._inbox.append)

    def publish(self, envelope: Envelope) -> None:
        """Send to all roles that hear the stream."""
        self._bus.deliver(envelope)

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        """Next message. In one thread nobody else can still send one: an empty inbox raises."""
        if not self._inbox:
            raise PeerLost(f"{self.role} waits for {awaited}, but nothing was sent")
        return self._inbox.popleft()

    def pending(self) -> bool:
        """Whether a message is there."""
        return bool(self._inbox)

    def close(self) -> None:
        """Nothing to do: the bus goes with the process."""
