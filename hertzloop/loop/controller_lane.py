"""The controller's end of the shared memory (lane) between plant and controller."""

import math
import time

import numpy as np

from hertzloop.bus import lane, lane_kernels
from hertzloop.bus.lane_kernels import FORCES_PUT, SAMPLES_PUT, WAITED_NS
from hertzloop.bus.streams import StreamFault
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.controller import Controller, Reply
from hertzloop.controller.kernels import EMITTED
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.kernels import GAP, NO_NUMBER, SILENT

_ROOM = 16_000  # samples between two calls of `reply`
_SPARE = 1_000  # samples for which there must be room before the next reply


class ControllerLane:
    """Answers samples in shared memory, and keeps the answers until they are published.

    Attributes:
        total: Samples of the whole run.
        idle_s: Time since the last sample arrived.
    """

    def __init__(self, controller: Controller, end: lane_kernels.Lane, look_ahead: bool) -> None:
        """
        Args:
            controller: The controller, which may have answered samples before.
            end: This side's end of the shared memory.
            look_ahead: Whether to send forces as soon as they are known, ahead of their step.
        """
        self._controller, self._end, self._look_ahead = controller, end, look_ahead
        self.total = len(controller.law_state.history)
        self.idle_s = 0.0
        self._modes, self._delays = (np.zeros(_ROOM, np.int64) for _ in range(2))
        self._unpublished = self._confirmed = self.samples  # first sample of each kind
        self._unpublished_step = int(controller.line_state.counts[EMITTED])
        end.own[FORCES_PUT] = self._unpublished_step
        end.own[SAMPLES_PUT] = self._unpublished
        # Blocks from the bus that shared memory has not reached: sequence, first sample, values.
        self._expected: list[tuple[int, int, np.ndarray]] = []
        self._last_sample_s = time.monotonic()

    @property
    def samples(self) -> int:
        """Number of samples that were answered."""
        return int(self._controller.law_state.counts[laws.SAMPLES])

    @property
    def waited_s(self) -> float:
        """Wall time in which this side has waited for the plant."""
        return 1e-9 * float(self._end.own[WAITED_NS])

    @property
    def full(self) -> bool:
        """Whether the answers must be published before many more samples are answered."""
        return self.samples - self._unpublished > _ROOM - _SPARE

    def answer_samples(self, limit: int) -> None:
        """Answer samples until `limit` of the run are answered, or none has come for a while.

        Raises:
            StreamFault: A sample is impossible, or the law has failed.
        """
        controller, before = self._controller, self.samples
        status = loop_kernels.answer_samples(
            controller.law,
            controller.law_state,
            controller.line,
            controller.line_state,
            controller.forces,
            self._modes,
            self._delays,
            self._end,
            self._unpublished,
            min(limit, self._unpublished + _ROOM),
            self._look_ahead,
        )
        try:
            controller.check()
        except LawFault as error:
            raise StreamFault(str(error)) from error
        if status == GAP:
            raise StreamFault(f"sample {self.samples} is missing in the lane")
        if status == NO_NUMBER:
            raise StreamFault(f"sample {self.samples} in the lane is no finite number")
        now = time.monotonic()
        if status != SILENT or self.samples != before:
            self._last_sample_s = now
        self.idle_s = now - self._last_sample_s
        self._confirm()

    def reply(self) -> Reply:
        """Return the answers since the last call."""
        controller, first, first_step = self._controller, self._unpublished, self._unpublished_step
        count, end = self.samples - first, int(controller.line_state.counts[EMITTED])
        level = float(laws.quiet_level(controller.law, controller.law_state))
        promises = level < math.inf and bool(controller_kernels.is_quiet(controller.line_state))
        self._unpublished, self._unpublished_step = self.samples, end
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
        """Compare a block of samples from the bus with those from shared memory.

        Samples that shared memory has not brought yet are compared later.

        Raises:
            StreamFault: They differ.
        """
        self._expected.append((sequence, first, values))
        self._confirm()

    def _confirm(self) -> None:
        while self._expected and self._expected[0][1] + len(self._expected[0][2]) <= self.samples:
            sequence, first, values = self._expected.pop(0)
            taken = self._controller.law_state.history[first : first + len(values)]
            sent = np.ascontiguousarray(values, np.float64).view(np.int64)
            differs = np.flatnonzero(sent != taken.view(np.int64))
            if len(differs):
                raise StreamFault(
                    f"stream 'daq' sequence {sequence} differs from what the lane brought at "
                    f"sample {first + int(differs[0])}"
                )
            self._confirmed = first + len(values)

    def reconcile(self) -> None:
        """At the end of the run, raise StreamFault unless the bus has confirmed every sample."""
        if self._confirmed != self.samples:
            raise StreamFault(
                f"the lane brought {self.samples} samples, stream 'daq' {self._confirmed}"
            )

    def leave(self) -> None:
        """Release a plant that waits in shared memory."""
        lane.leave(self._end)
