"""The controller's answers: given to samples from the bus or from shared memory, then published."""

import math
import time
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from hertzloop.bus.ring_kernels import FORCES_PUT, OPEN, SAMPLES_ANSWERED, Ring
from hertzloop.bus.streams import StreamFault
from hertzloop.closed_loop.answer import Job, answer
from hertzloop.closed_loop.exchange import GAP, NO_NUMBER, SILENT
from hertzloop.closed_loop.parts import NO_RING, controller_side, elsewhere
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.controller import Controller
from hertzloop.controller.kernels import EMITTED

_ROOM = 16_000  # samples in the ring that are answered before they must be published
_SPARE = 1_000  # samples for which there must be room before the next reply


@dataclass(frozen=True)
class AnswerBlock:
    """What samples led to.

    Attributes:
        first_step: Step of the first force.
        forces: Commanded forces that became known, N.
        samples: Number of samples that were answered.
        trigger_level: Level above which samples leave the force at zero; inf without one.
        modes, delays: Of the law after each sample of the reply.
    """

    first_step: int
    forces: np.ndarray
    samples: int
    trigger_level: float
    modes: np.ndarray
    delays: np.ndarray

    @property
    def zero_until_trigger(self) -> bool:
        """Whether the force stays zero while samples stay above the level."""
        return self.trigger_level < math.inf


def load() -> None:
    """Load the compiled kernel, or compile it."""
    answer(elsewhere(np.zeros(0)), _no_job(NO_RING, 0, False), 0)


def _no_job(ring: Ring, room: int, commands_ahead: bool) -> Job:
    modes, delays = np.zeros(room, np.int64), np.zeros(room, np.int64)
    level = np.full(1, math.inf)
    return Job(np.zeros(0), ring, modes, delays, level, 0, commands_ahead)


class Answering:
    """Answers samples, and keeps the answers until they are published.

    Attributes:
        total: Samples of the whole run.
        idle_s: Time since the last sample arrived in the ring.
    """

    def __init__(self, controller: Controller, commands_ahead: bool = True) -> None:
        """
        Args:
            controller: The controller of the run.
            commands_ahead: Whether to send forces as soon as they are known, ahead of their step.
        """
        self._controller, self._side = controller, controller_side(controller)
        self._job = _no_job(NO_RING, 0, commands_ahead)
        self.total = len(controller.law_state.history)
        self.idle_s = 0.0
        self._last_sample_s = 0.0
        self._replied_step = int(controller.path_state.counts[EMITTED])
        # Blocks from the bus that the ring has not reached: sequence, first sample, end, checksum.
        self._unchecked: list[tuple[int, int, int, int]] = []

    @property
    def taken(self) -> int:
        """Number of samples that the law was given."""
        return int(self._controller.law_state.counts[laws.SAMPLES])

    @property
    def samples(self) -> int:
        """Number of samples that were answered."""
        return int(self._job.ring.own[SAMPLES_ANSWERED]) if self.in_ring else self.taken

    @property
    def in_ring(self) -> bool:
        """Whether samples come in shared memory."""
        return bool(self._job.ring.own[OPEN])

    @property
    def full(self) -> bool:
        """Whether the answers must be published before many more samples are answered."""
        return self.samples - self._job.first > _ROOM - _SPARE

    def use_ring(self, ring: Ring) -> None:
        """Answer further samples in shared memory."""
        ring.own[OPEN], ring.own[SAMPLES_ANSWERED] = 1, self.samples
        ring.own[FORCES_PUT] = self._replied_step
        new = _no_job(ring, _ROOM, self._job.commands_ahead)
        self._job = new._replace(first=self.samples)
        self._last_sample_s = time.monotonic()

    def answer_block(self, values: np.ndarray) -> None:
        """Answer the samples of a block, all finite. Raises LawFault if the law fails."""
        modes, delays = np.zeros(len(values), np.int64), np.zeros(len(values), np.int64)
        self._job = self._job._replace(
            values=np.ascontiguousarray(values, float),
            modes=modes,
            delays=delays,
            first=self.samples,
        )
        answer(self._side, self._job, self.samples + len(values))
        self._controller.check()

    def answer_in_ring(self, limit: int) -> None:
        """Answer samples until `limit` of the run are answered, or none has come for a while.

        Raises:
            StreamFault: A sample is impossible.
            LawFault: The law has failed.
        """
        before = self.taken
        status = answer(self._side, self._job, min(limit, self.total, self._job.first + _ROOM))
        self._controller.check()
        if status == GAP:
            raise StreamFault(f"sample {self.taken} is missing in the ring")
        if status == NO_NUMBER:
            raise StreamFault(f"sample {self.taken} in the ring is no finite number")
        now = time.monotonic()
        if status != SILENT or self.taken != before:
            self._last_sample_s = now
        self.idle_s = now - self._last_sample_s
        self._check_blocks()

    def check_block(self, sequence: int, first: int, count: int, checksum: int) -> None:
        """Check what the ring has brought by a block of samples from the bus.

        Samples that the ring has not brought yet are checked later.

        Raises:
            StreamFault: The ring has brought other samples.
        """
        self._unchecked.append((sequence, first, first + count, checksum))
        self._check_blocks()

    def _check_blocks(self) -> None:
        while self._unchecked and self._unchecked[0][2] <= self.taken:
            sequence, first, end, checksum = self._unchecked.pop(0)
            if crc32(self._controller.law_state.history[first:end]) != checksum:
                raise StreamFault(
                    f"stream 'daq' sequence {sequence}: samples {first} to {end - 1} differ from "
                    "what the ring brought"
                )

    def reconcile(self) -> None:
        """At the end of the run, raise StreamFault unless every block was checked."""
        if self._unchecked:
            raise StreamFault(
                f"the ring brought {self.taken} samples, stream 'daq' {self._unchecked[-1][2]}"
            )

    def reply(self) -> AnswerBlock:
        """Return the answers since the last call. A force that is not in the ring is left out."""
        now, first, samples = self._job, self._replied_step, self.samples
        own, path = now.ring.own, self._controller.path_state
        end = int(own[FORCES_PUT] if self.in_ring else path.counts[EMITTED])
        count, left = samples - now.first, self.taken - samples
        modes, delays = now.modes[:count].copy(), now.delays[:count].copy()
        for row in (now.modes, now.delays):
            row[:left] = row[count : count + left].copy()
        self._job, self._replied_step = now._replace(first=samples), end
        return AnswerBlock(
            first_step=first,
            forces=self._controller.forces[first:end],
            samples=samples,
            trigger_level=float(now.trigger_level[0]),
            modes=modes,
            delays=delays,
        )


def answer_samples(
    controller: Controller, values: np.ndarray, commands_ahead: bool = True
) -> AnswerBlock:
    """Let a controller answer samples, all finite, as it answers a block from the bus.

    Raises LawFault if the law fails.
    """
    answering = Answering(controller, commands_ahead)
    answering.answer_block(values)
    return answering.reply()
