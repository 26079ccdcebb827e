"""The plant's side of the fast lane: the offer, what becomes of it, how long it may be silent."""

import time

from bus.lane import Segment, leave, sleep_precisely
from bus.messages_pb2 import Hello, LaneAnswer
from bus.port import PeerLost
from bus.streams import StreamFault
from hertzloop.loop import kernels as k
from hertzloop.loop.answers import Answers, refusal


class LaneOffer:
    """Offers a lane in `hello`; `became` is the name of the controller's LaneAnswer, "" if none was
    offered."""

    def __init__(
        self, hello: Hello, run_id: int, every_steps: int, answers: Answers, timeout_s: float
    ) -> None:
        self.became = ""
        self._answers, self._timeout_s = answers, timeout_s
        self._segment: Segment | None = None
        self._quiet = (-1, 0.0)  # samples that were answered in the lane, and since when
        try:
            self._segment = Segment(run_id, hello.steps, every_steps)
        except OSError:  # no such memory here
            return
        self.became = LaneAnswer.Name(LaneAnswer.UNSAID)
        hello.lane.CopyFrom(self._segment.offer)

    def hear(self, answer: "LaneAnswer", sent: int) -> None:
        """What the controller's first block says of it; `sent` samples went over the bus. Raises
        StreamFault."""
        if self._segment is None:
            return
        self.became = LaneAnswer.Name(answer)
        if answer == LaneAnswer.JOINED:
            if self._answers.samples != sent:
                raise StreamFault(
                    f"the controller joined the lane when it had answered {self._answers.samples} "
                    f"of {sent} samples"
                )
            self._answers.through(self._segment.end)
            sleep_precisely()
        self._segment.withdraw()
        self._segment = None

    def checked(self, said: int) -> int:
        """How a kernel ended, if the run can go on. Raises StreamFault, or PeerLost after too long
        a silence."""
        if said > k.SILENT:
            raise StreamFault(refusal(said, self._answers))
        if said == k.SILENT:
            seen, now = self._answers.samples, time.monotonic()
            if seen != self._quiet[0]:
                self._quiet = (seen, now)
            if now - self._quiet[1] > self._timeout_s:
                raise PeerLost(
                    f"plant waited {self._timeout_s:g} s for the force for step "
                    f"{self._answers.end} from the controller: nothing came in the lane",
                    "controller",
                )
        return said

    def leave(self) -> None:
        """Let nobody wait in the lane any longer, and nobody join it."""
        leave(self._answers.lane)
        if self._segment is not None:
            self._segment.withdraw()
