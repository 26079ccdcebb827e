"""The plant's end of the shared memory (lane) between plant and controller."""

import time

from hertzloop.bus.lane import Segment, leave, sleep_precisely
from hertzloop.bus.lane_kernels import TAKEN
from hertzloop.bus.messages_pb2 import Hello, LaneAnswer
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import StreamFault
from hertzloop.loop.force_buffer import ForceBuffer
from hertzloop.loop.kernels import (
    BEYOND_END,
    BROKEN_PROMISE,
    GAP,
    NO_NUMBER,
    SILENT,
    WRONG_COUNT,
)


class PlantLane:
    """Offers shared memory in `hello`, and switches to it if the controller joins.

    Attributes:
        outcome: Name of the controller's LaneAnswer, or "" if no shared memory was offered.
    """

    def __init__(
        self, hello: Hello, run_id: int, every_steps: int, buffer: ForceBuffer, timeout_s: float
    ) -> None:
        """
        Args:
            hello: First message of the run; the offer is written into it.
            run_id: Number of the run.
            every_steps: Steps from one sample to the next.
            buffer: Receives the forces.
            timeout_s: Longest silence of the controller.
        """
        self.outcome = ""
        self._buffer, self._timeout_s = buffer, timeout_s
        self._segment: Segment | None = None
        self._samples_at_last_change, self._last_change_s = -1, 0.0
        try:
            self._segment = Segment(run_id, hello.steps, every_steps)
        except OSError:  # this machine has no shared memory
            return
        self.outcome = LaneAnswer.Name(LaneAnswer.NOT_STATED)
        hello.lane.CopyFrom(self._segment.offer)

    def receive_answer(self, answer: "LaneAnswer", sent: int) -> None:
        """Read the controller's answer to the offer, from its first block of forces.

        Args:
            answer: Whether the controller has joined, or why it has not.
            sent: Samples that were sent over the bus until now.

        Raises:
            StreamFault: The controller has joined before it answered all of these samples.
        """
        if self._segment is None:
            return
        self.outcome = LaneAnswer.Name(answer)
        if answer == LaneAnswer.JOINED:
            if self._buffer.samples != sent:
                raise StreamFault(
                    f"the controller joined the lane when it had answered {self._buffer.samples} "
                    f"of {sent} samples"
                )
            self._buffer.use_lane(self._segment.end)
            sleep_precisely()
        self._segment.withdraw()
        self._segment = None

    def check(self, status: int) -> None:
        """Check how a kernel of the loop has ended.

        Raises:
            StreamFault: Shared memory holds something impossible.
            PeerLost: The controller has been silent for too long.
        """
        if status > SILENT:
            raise StreamFault(fault_in_lane(status, self._buffer))
        if status == SILENT:
            samples, now = self._buffer.samples, time.monotonic()
            if samples != self._samples_at_last_change:
                self._samples_at_last_change, self._last_change_s = samples, now
            if now - self._last_change_s > self._timeout_s:
                raise PeerLost(
                    f"plant waited {self._timeout_s:g} s for the force for step "
                    f"{self._buffer.end} from the controller: nothing came in the lane",
                    "controller",
                )

    def leave(self) -> None:
        """Release a controller that waits in shared memory, and let none join later."""
        leave(self._buffer.lane)
        if self._segment is not None:
            self._segment.withdraw()


def fault_in_lane(status: int, buffer: ForceBuffer) -> str:
    """Return a sentence for a status that names a fault in shared memory."""
    record, step = int(buffer.lane.own[TAKEN]) - 1, buffer.end
    faults = {
        GAP: "has another number than was expected",
        WRONG_COUNT: "answers samples that were not sent, or fewer than before",
        BEYOND_END: f"holds a force beyond the run's {len(buffer.forces)} steps",
        NO_NUMBER: "holds a number that is infinite",
        BROKEN_PROMISE: f"breaks the promise of zero force in step {step}, which is over",
    }
    return f"answer {record} in the lane {faults[status]}"
