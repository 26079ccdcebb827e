"""Forces received from the controller, and the step up to which the plant may run."""

import math

import numpy as np

from hertzloop.bus import lane, lane_kernels
from hertzloop.bus.lane_kernels import OPEN
from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.bus.streams import StreamFault
from hertzloop.common.uncompiled import plain
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.kernels import (
    FORCES_END,
    GRANT_COUNTS,
    GRANTED_END,
    OBSERVED,
    PROMISED,
    SAMPLES_FIRST,
    SEEN,
)
from hertzloop.scene.setup import Setup

# Interpreted: once a message, compiling it for that would only lengthen the first run.
_update_promise = plain(loop_kernels.update_promise)


class ForceBuffer:
    """Commanded forces by step, filled from the bus or from shared memory (the lane).

    Attributes:
        forces: Commanded force of each step, N, shape (steps,). Zero where none was received.
        grant: Up to which step the forces are known, for the compiled loop.
        lane: Plant's end of the shared memory. It is closed until `use_lane` is called.
    """

    def __init__(
        self, setup: Setup, window: loop_kernels.Window, held_steps: np.ndarray | None = None
    ) -> None:
        """
        Args:
            setup: Setup of the run.
            window: Samples and time series that the plant has produced.
            held_steps: For each step, how many steps older than that step its command was, in a
                run that does not wait for forces. None in lock-step.
        """
        self.forces = np.zeros(setup.run.steps)
        self.lane = lane.closed()
        self.grant = loop_kernels.TimeGrant(
            counts=np.zeros(GRANT_COUNTS, np.int64),
            level=np.full(1, math.inf),  # no promise yet: any sample would break it
            lookahead_steps=1 + setup.signal_path.latency_steps,
        )
        self._window, self._held_steps = window, held_steps
        self._confirmed = 0  # steps whose force has also been received over the bus

    @property
    def end(self) -> int:
        """Number of steps whose force was received. Promised zeros do not count."""
        return int(self.grant.counts[FORCES_END])

    @property
    def samples(self) -> int:
        """Number of samples that the controller has answered."""
        return int(self.grant.counts[SEEN])

    @property
    def uses_lane(self) -> bool:
        """Whether forces arrive in shared memory."""
        return bool(self.lane.own[OPEN])

    def use_lane(self, end: lane_kernels.Lane) -> None:
        """Receive further forces in shared memory. The bus then only confirms them."""
        self.lane, self._confirmed = end, self.end
        end.own[OPEN] = 1

    def missing_at(self, step: int) -> bool:
        """Return whether the sample of `step` was taken and its force is not known."""
        counts = self.grant.counts
        observed = self._window.counts[OBSERVED] > step
        granted = counts[PROMISED] or counts[GRANTED_END] > step
        return bool(observed and not granted and step < len(self.forces))

    def receive(self, header: ForceBlock, forces: np.ndarray, step: int) -> None:
        """Add a block of forces from the bus.

        Args:
            header: Header of the block.
            forces: Forces of the block, N.
            step: Present step of the plant.

        Raises:
            StreamFault: The block is impossible, or contradicts an earlier promise of zero force.
        """
        first, end = header.first_step, header.first_step + len(forces)
        sent = int(self._window.counts[SAMPLES_FIRST])
        if end > len(self.forces):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} reaches step {end}, "
                f"the run has {len(self.forces)}"
            )
        if not self.samples <= header.samples_seen <= sent:
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} answers {header.samples_seen} samples, "
                f"{sent} were sent and {self.samples} answered before"
            )
        past = min(step, end)
        broken = self.forces[first:past] != forces[: max(0, past - first)]
        if self._held_steps is not None:
            broken &= self._held_steps[first:past] == 0  # a late force was not promised
        if np.any(broken):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} breaks the promise of zero force "
                f"in steps {first} to {past - 1}, which are over"
            )
        self.forces[first:end] = forces
        counts = self.grant.counts
        counts[FORCES_END] = end
        counts[SEEN] = header.samples_seen
        counts[GRANTED_END] = max(counts[GRANTED_END], end)
        _update_promise(
            header.samples_seen, header.promise_zero, header.promise_level, self._window, self.grant
        )

    def confirm(self, header: ForceBlock, forces: np.ndarray) -> None:
        """Compare a block from the bus with the forces from shared memory, bit by bit.

        Raises:
            StreamFault: They differ, or shared memory has not brought these forces.
        """
        first, end = header.first_step, header.first_step + len(forces)
        if end > self.end:
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} reaches step {end}, the lane brought "
                f"forces of {self.end} steps"
            )
        sent = np.ascontiguousarray(forces, np.float64).view(np.int64)
        differs = np.flatnonzero(sent != self.forces[first:end].view(np.int64))
        if len(differs):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} differs from what the lane brought at "
                f"step {first + int(differs[0])}"
            )
        self._confirmed = end

    def all_confirmed(self) -> bool:
        """Return whether the bus has confirmed every force from shared memory."""
        return not self.uses_lane or self._confirmed == self.end
