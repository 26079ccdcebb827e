"""Plant, controller and recorder joined by links with delays drawn from a seed, in one thread.

Every link keeps the order of its messages, as a connection does; when they arrive, and who works
next, is drawn.
"""

import hashlib
from collections import deque
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hertzloop.bus import codec
from hertzloop.bus.port import PeerLost
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import (
    CONTROLLER,
    PLANT,
    RECORDER,
    STREAMS,
    SUBSCRIPTIONS,
    Envelope,
    StreamFault,
)
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.plant_node import PlantNode
from hertzloop.loop.run_options import RunOptions
from hertzloop.scene.setup import Setup

Alter = Callable[[Envelope], Iterable[Envelope]]


def as_it_is(envelope: Envelope) -> Iterable[Envelope]:
    """Passes every message on."""
    return (envelope,)


def forces(change: Callable[[Any, np.ndarray], np.ndarray | None]) -> Alter:
    """Passes on what `change` makes of header (in place) and forces of a block; of None: nothing
    else than before."""

    def alter(envelope: Envelope) -> Iterable[Envelope]:
        if envelope.stream != "force":
            return (envelope,)
        block = codec.decode(STREAMS["force"].message, envelope.payload)
        made = change(block.header, block.arrays["force_n"].copy())
        force = block.arrays["force_n"] if made is None else made
        return (Envelope("force", codec.encode(block.header, force_n=force)),)

    return alter


@dataclass
class Heard:
    """What the recorder heard: digests of the samples of every stream, joined over its blocks,
    and the order in which the streams came."""

    digests: dict[str, Any] = field(default_factory=dict)
    order: list[str] = field(default_factory=list)

    def take(self, stream: str, block: codec.DecodedBlock) -> None:
        """Add one message."""
        self.order.append(stream)
        if not STREAMS[stream].compared:
            return
        if not block.arrays:
            self._digest(stream).update(block.header.SerializeToString())
        for name, values in block.arrays.items():
            self._digest(f"{stream}.{name}").update(values.tobytes())

    def _digest(self, name: str) -> Any:
        return self.digests.setdefault(name, hashlib.sha256())

    def samples(self) -> dict[str, str]:
        """Digest of every compared array."""
        return {name: digest.hexdigest() for name, digest in self.digests.items()}


class _Port:
    """Port of one role on the links."""

    def __init__(self, links: "Links", role: str) -> None:
        self.role, self._links = role, links
        self.inbox: deque[Envelope] = deque()

    def publish(self, envelope: Envelope) -> None:
        self._links.send(self.role, envelope)

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        while not self.inbox:
            if not self._links.move():
                raise PeerLost(f"{self.role} waits for {awaited}: nothing is under way")
        return self.inbox.popleft()

    def pending(self) -> bool:
        self._links.some_moves()
        return bool(self.inbox)

    def close(self) -> None:
        pass


class Links:
    """The links between the three; `alter` is what a broken controller does to what it says,
    `forge` what is put on the plant's link to the controller."""

    def __init__(self, seed: int, alter: Alter = as_it_is, forge: Alter = as_it_is) -> None:
        self._draw = np.random.default_rng(seed)
        self._patience = self._draw.random()  # how much moves between two blocks, this time
        self._alter, self._forge = alter, forge
        self.ports = {role: _Port(self, role) for role in (PLANT, CONTROLLER, RECORDER)}
        self._under_way: dict[tuple[str, str], deque[Envelope]] = {}
        self.controller: Any = None
        self._idle = True
        self.fault = self.recorder_fault = ""  # of the controller, of the recorder
        self.heard, self.checker = Heard(), SequenceChecker()
        self.ends: list[Any] = []

    def send(self, role: str, envelope: Envelope) -> None:
        """Put a message on the links to those who hear its stream."""
        for said in self._alter(envelope) if role == CONTROLLER else (envelope,):
            for hears in self.ports:
                if said.stream not in SUBSCRIPTIONS[hears]:
                    continue
                link = self._under_way.setdefault((role, hears), deque())
                link.extend(self._forge(said) if hears == CONTROLLER else (said,))
        self.some_moves()

    def some_moves(self) -> None:
        """Let a drawn number of messages arrive."""
        while self._draw.random() < self._patience and self.move():
            pass

    def move(self) -> bool:
        """Let one message of a drawn link arrive, or the controller work; False if all is done."""
        links = [link for link, waiting in self._under_way.items() if waiting]
        works = self._idle and bool(self.ports[CONTROLLER].inbox)
        if not links and not works:
            return False
        choice = int(self._draw.integers(len(links) + works))
        if choice == len(links):
            self._work()
        else:
            arrived = self._under_way[links[choice]].popleft()
            self.ports[links[choice][1]].inbox.append(arrived)
            self._record()
        return True

    def _work(self) -> None:
        """One message through the controller, as its process does it."""
        node = self.controller
        self._idle = False  # while it speaks it does not listen
        try:
            node.handle(self.ports[CONTROLLER].inbox.popleft())
        except StreamFault as error:
            self.fault = str(error)
            node.fail(str(error))
        else:
            self._idle = not node.done

    def _record(self) -> None:
        inbox = self.ports[RECORDER].inbox
        while inbox:
            envelope = inbox.popleft()
            try:
                block = self.checker.accept(envelope)
            except StreamFault as error:
                self.recorder_fault = self.recorder_fault or str(error)
                continue
            self.heard.take(envelope.stream, block)
            if envelope.stream.startswith("end/"):
                self.ends.append(block.header)


def exchange(
    scene: Setup,
    seed: int,
    *,
    max_exchange_steps: int | None = None,
    controller: Callable[[Any], Any] = ControllerNode,
    alter: Alter = as_it_is,
    forge: Alter = as_it_is,
    every_s: float = 0.0,
) -> Links:
    """A whole run over links of a seed. Raises what the plant raises; everything arrives first."""
    links = Links(seed, alter, forge)
    links.controller = controller(links.ports[CONTROLLER])
    plant = PlantNode(
        scene,
        links.ports[PLANT],
        RunOptions(max_exchange_steps=max_exchange_steps, shared_memory=False),
        every_s=every_s,
    )
    try:
        plant.run()
    finally:
        while links.move():
            pass
    try:
        for end in links.ends:
            links.checker.reconcile(end)
    except StreamFault as error:
        links.recorder_fault = links.recorder_fault or str(error)
    return links
