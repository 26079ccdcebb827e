"""What the controller sends to the plant: forces from the bus, or from shared memory."""

from zlib import crc32

import numpy as np

from hertzloop.bus.messages_pb2 import ForceBlock, Hello, SharedMemoryAnswer
from hertzloop.bus.ring_kernels import OPEN, TAKEN
from hertzloop.bus.shared_memory import Segment, leave, sleep_precisely
from hertzloop.bus.streams import StreamFault
from hertzloop.closed_loop import grant as grants
from hertzloop.closed_loop.exchange import (
    ANSWERED,
    FORCES_END,
    SAMPLES_END,
    SAMPLES_FIRST,
    Exchange,
    Status,
    Unsent,
)
from hertzloop.common.uncompiled import plain

# Interpreted: once a message, compiling them for that would only lengthen the first run.
_extend, _renew = plain(grants.extend), plain(grants.renew)


def accept_block(
    exchange: Exchange, unsent: Unsent, header: ForceBlock, forces: np.ndarray, step: int
) -> None:
    """Accept a block of forces from the bus.

    Args:
        exchange: Receives the forces.
        unsent: Samples that the plant has taken.
        header: Header of the block.
        forces: Forces of the block, N.
        step: Present step of the plant.

    Raises:
        StreamFault: The block is impossible, or a force that was to stay zero is not.
    """
    known, counts, held = exchange.controller.forces, exchange.counts, exchange.clock.held_steps
    first, end = header.first_step, header.first_step + len(forces)
    sent, answered = int(unsent.counts[SAMPLES_FIRST]), int(counts[ANSWERED])
    block = f"stream 'force' sequence {header.sequence}"
    if end > len(known):
        raise StreamFault(f"{block} reaches step {end}, the run has {len(known)}")
    if not answered <= header.samples_seen <= sent:
        raise StreamFault(
            f"{block} answers {header.samples_seen} samples, {sent} were sent and {answered} "
            "answered before"
        )
    past = max(first, min(step, end))
    differs = known[first:past] != forces[: past - first]
    if len(held):
        differs &= held[first:past] == 0  # a step that went without its force was not granted
    if np.any(differs):
        raise StreamFault(
            f"{block} has forces in steps {first} to {past - 1}, which are over and in which the "
            "force was to stay zero until the trigger"
        )
    known[first:end] = forces
    counts[FORCES_END], counts[ANSWERED] = end, header.samples_seen
    _extend(exchange.grant, end)
    level = header.trigger_level if header.zero_until_trigger else np.inf
    _renew(exchange.grant, level, header.samples_seen, int(unsent.counts[SAMPLES_END]))


def check_forces(exchange: Exchange, header: ForceBlock, count: int) -> None:
    """Check what the ring has brought by a block of forces from the bus.

    Raises:
        StreamFault: The ring has brought fewer forces, or others.
    """
    first, end = header.first_step, header.first_step + count
    brought = int(exchange.counts[FORCES_END])
    if end > brought:
        raise StreamFault(
            f"stream 'force' sequence {header.sequence} reaches step {end}, the ring brought "
            f"forces of {brought} steps"
        )
    if crc32(exchange.controller.forces[first:end]) != header.checksum:
        raise StreamFault(
            f"stream 'force' sequence {header.sequence}: forces of steps {first} to {end - 1} "
            "differ from what the ring brought"
        )


def fault_in_ring(status: Status, exchange: Exchange) -> str:
    """Return a sentence for a status that names a fault in shared memory."""
    record, step = int(exchange.ring.own[TAKEN]) - 1, int(exchange.counts[FORCES_END])
    faults = {
        Status.GAP: "has another number than was expected",
        Status.WRONG_COUNT: "answers samples that were not sent, or fewer than before",
        Status.BEYOND_END: f"holds a force beyond the run's {len(exchange.commands)} steps",
        Status.NO_NUMBER: "holds a number that is infinite",
        Status.NOT_ZERO: f"holds a force of step {step}, which is over and in which it was to stay "
        "zero until the trigger",
    }
    return f"answer {record} in the ring {faults[status]}"


class SharedMemory:
    """Shared memory that the plant offers, and uses if the controller joins.

    Attributes:
        outcome: Name of the controller's answer, or "" if nothing could be offered.
    """

    def __init__(self, hello: Hello, run_id: int, every_steps: int) -> None:
        """
        Args:
            hello: First message of the run; the offer is written into it.
            run_id: Number of the run.
            every_steps: Steps from one sample to the next.
        """
        self.outcome = ""
        self._segment: Segment | None = None
        try:
            self._segment = Segment(run_id, hello.steps, every_steps)
        except OSError:  # this machine has no shared memory
            return
        self.outcome = SharedMemoryAnswer.Name(SharedMemoryAnswer.NOT_STATED)
        hello.shared_memory.CopyFrom(self._segment.offer)

    def receive_answer(
        self, answer: "SharedMemoryAnswer", exchange: Exchange, sent: int
    ) -> Exchange:
        """Read the controller's answer to the offer, from its first block of forces.

        Args:
            answer: Whether the controller has joined, or why it has not.
            exchange: Exchange until now.
            sent: Samples that were sent over the bus until now.

        Returns:
            The exchange from now on.

        Raises:
            StreamFault: The controller has joined before it answered all of these samples.
        """
        if self._segment is None:
            return exchange
        segment, self._segment = self._segment, None
        self.outcome = SharedMemoryAnswer.Name(answer)
        if answer == SharedMemoryAnswer.JOINED:
            answered = int(exchange.counts[ANSWERED])
            if answered != sent:
                raise StreamFault(
                    f"the controller joined the shared memory when it had answered {answered} of "
                    f"{sent} samples"
                )
            exchange = exchange._replace(ring=segment.end)
            exchange.ring.own[OPEN] = 1
            sleep_precisely()
        segment.withdraw()
        return exchange

    def leave(self, exchange: Exchange) -> None:
        """Release a controller that waits in the ring, and let none join later."""
        if exchange.ring.own[OPEN]:
            leave(exchange.ring)
        if self._segment is not None:
            self._segment.withdraw()
            self._segment = None
