"""The plant's side of the fast lane: the offer, what becomes of it, how long it may be silent."""

import math
import time

import numpy as np

from bus import lane, lane_kernels
from bus.lane import Segment, leave, sleep_precisely
from bus.messages_pb2 import Hello, LaneAnswer
from bus.port import PeerLost
from bus.streams import StreamFault
from controller import kernels as ck
from controller import law_kernels as laws
from controller.controller import Controller, Reply
from controller.loading.bound import LawFault
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


_ROOM = 16_000  # samples between two calls of reply


class LaneAnswers:
    """Answers through one end of a lane, kept until they are published, too."""

    def __init__(self, controller: Controller, end: lane_kernels.Lane, look_ahead: bool) -> None:
        """From what the controller has answered until now."""
        self._controller, self._end, self._look_ahead = controller, end, look_ahead
        self.total = len(controller.law_state.history)
        self.idle_s = 0.0  # for which no sample has come
        self._modes, self._delays = (np.zeros(_ROOM, np.int64) for _ in range(2))
        self._first = self._confirmed = self.samples  # not published yet; compared with the bus
        self._first_step = int(controller.line_state.counts[ck.EMITTED])
        end.own[lane_kernels.FORCES_PUT] = self._first_step
        end.own[lane_kernels.SAMPLES_PUT] = self._first
        self._heard: list[tuple[int, int, np.ndarray]] = []  # daq: sequence, first sample, values
        self._since = time.monotonic()

    @property
    def samples(self) -> int:
        """Samples that were taken."""
        return int(self._controller.law_state.counts[laws.SAMPLES])

    @property
    def full(self) -> bool:
        """Whether there is no room for a thousand samples more before the next reply."""
        return self.samples - self._first > _ROOM - 1000

    def serve(self, limit: int) -> None:
        """Answer samples up to `limit`, at most until the lane is silent for a while. Raises
        StreamFault when a sample cannot be, or the law fails."""
        controller, before = self._controller, self.samples
        said = k.serve(
            controller.law, controller.law_state, controller.line, controller.line_state,
            controller.forces, self._modes, self._delays, self._end, self._first,
            min(limit, self._first + _ROOM), self._look_ahead,
        )  # fmt: skip
        try:
            controller.check()
        except LawFault as error:
            raise StreamFault(str(error)) from error
        if said == k.GAP:
            raise StreamFault(f"sample {self.samples} is missing in the lane")
        if said == k.NO_NUMBER:
            raise StreamFault(f"sample {self.samples} in the lane is no finite number")
        now = time.monotonic()
        if said != k.SILENT or self.samples != before:
            self._since = now
        self.idle_s = now - self._since
        self._confirm()

    def reply(self) -> Reply:
        """What was answered since the last call."""
        controller, first, first_step = self._controller, self._first, self._first_step
        count, end = self.samples - first, int(controller.line_state.counts[ck.EMITTED])
        level = float(laws.quiet_level(controller.law, controller.law_state))
        promises = level < math.inf and bool(ck.is_quiet(controller.line_state))
        self._first, self._first_step = self.samples, end
        return Reply(
            first_step=first_step,
            forces=controller.forces[first_step:end],
            samples_seen=self.samples,
            promise_zero=promises,
            promise_level=level if promises else 0.0,
            modes=self._modes[:count].copy(),
            delays=self._delays[:count].copy(),
        )

    def expect(self, sequence: int, first: int, values: np.ndarray) -> None:
        """A block of the bus with samples from `first` on: the lane brings the same. Raises
        StreamFault."""
        self._heard.append((sequence, first, values))
        self._confirm()

    def _confirm(self) -> None:
        while self._heard and self._heard[0][1] + len(self._heard[0][2]) <= self.samples:
            sequence, first, values = self._heard.pop(0)
            taken = self._controller.law_state.history[first : first + len(values)]
            ours = np.ascontiguousarray(values, np.float64).view(np.int64)
            differs = np.flatnonzero(ours != taken.view(np.int64))
            if len(differs):
                raise StreamFault(
                    f"stream 'daq' sequence {sequence} differs from what the lane brought at "
                    f"sample {first + int(differs[0])}"
                )
            self._confirmed = first + len(values)

    def reconcile(self) -> None:
        """At the end of the run: the bus has brought all that the lane did. Raises StreamFault."""
        if self._confirmed != self.samples:
            raise StreamFault(
                f"the lane brought {self.samples} samples, stream 'daq' {self._confirmed}"
            )

    def leave(self) -> None:
        """Tell the plant not to wait any longer."""
        lane.leave(self._end)
