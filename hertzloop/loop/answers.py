"""Answers of the controller from the bus or the lane, and both ends of that lane."""

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.bus import lane, lane_kernels
from hertzloop.bus.lane import Segment, leave, sleep_precisely
from hertzloop.bus.lane_kernels import FORCES_PUT, OPEN, SAMPLES_PUT, TAKEN
from hertzloop.bus.messages_pb2 import ForceBlock, Hello, LaneAnswer
from hertzloop.bus.port import BusError, EndedByOther, PeerLost, Port
from hertzloop.bus.process_clock import clock
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import StreamFault
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.controller import Controller, Reply
from hertzloop.controller.kernels import EMITTED
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.kernels import (
    BEYOND_END,
    BROKEN_AT,
    BROKEN_PROMISE,
    FORCES_END,
    GAP,
    GRANT_COUNTS,
    GRANTED_END,
    NO_NUMBER,
    OBSERVED,
    PROMISED,
    SAMPLES_END,
    SAMPLES_FIRST,
    SEEN,
    SILENT,
    WRONG_COUNT,
)
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import UnreadableRecording
from hertzloop.scene.setup import Setup

_NOTICE_S = 1.0  # in which a controller that fails says so


class ForceBuffer:
    """Forces by step, what they reach to, and the lane that may bring them, closed at first."""

    def __init__(
        self, setup: Setup, window: loop_kernels.Window, held: np.ndarray | None = None
    ) -> None:
        """`held`: by how many steps the command of a step was too old, where it may be."""
        self.forces = np.zeros(setup.steps)
        self.lane = lane.closed()
        self.grant = loop_kernels.TimeGrant(
            counts=np.zeros(GRANT_COUNTS, np.int64),
            level=np.full(1, math.inf),  # no promise is known yet: any sample breaks it
            lookahead_steps=1 + setup.line.latency_steps,
        )
        self._window, self._held = window, held
        self._confirmed = 0  # steps whose force came over the bus, too

    @property
    def end(self) -> int:
        """Steps whose force has come, promised ones not counted."""
        return int(self.grant.counts[FORCES_END])

    @property
    def samples(self) -> int:
        """Samples that are answered."""
        return int(self.grant.counts[SEEN])

    @property
    def in_lane(self) -> bool:
        """Whether the lane brings them."""
        return bool(self.lane.own[OPEN])

    def through(self, end: lane_kernels.Lane) -> None:
        """From now on the lane brings them."""
        self.lane, self._confirmed = end, self.end
        end.own[OPEN] = 1

    def missing_at(self, step: int) -> bool:
        """Whether nothing is known of the force of `step`, of which the sample was taken."""
        counts = self.grant.counts
        observed = self._window.counts[OBSERVED] > step
        granted = counts[PROMISED] or counts[GRANTED_END] > step
        return bool(observed and not granted and step < len(self.forces))

    def take(self, header: ForceBlock, force: np.ndarray, step: int) -> None:
        """A block of the bus, at `step`. Raises StreamFault when it cannot be, or breaks what was
        promised before."""
        first, end = header.first_step, header.first_step + len(force)
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
        done = min(step, end)
        broken = self.forces[first:done] != force[: max(0, done - first)]
        if self._held is not None:
            broken &= self._held[first:done] == 0  # what came late was not promised
        if np.any(broken):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} breaks the promise of zero force "
                f"in steps {first} to {done - 1}, which are over"
            )
        self.forces[first:end] = force
        counts = self.grant.counts
        counts[FORCES_END] = end
        counts[SEEN] = header.samples_seen
        counts[GRANTED_END] = max(counts[GRANTED_END], end)
        # A promise speaks of samples after those seen; it holds if none of the later ones
        # that were already taken broke it.
        same_level = self.grant.level[0] == header.promise_level
        all_seen = header.samples_seen == self._window.counts[SAMPLES_END]
        if all_seen or (same_level and header.samples_seen >= counts[BROKEN_AT]):
            counts[PROMISED] = int(header.promise_zero)
            self.grant.level[0] = header.promise_level

    def confirm(self, header: ForceBlock, force: np.ndarray) -> None:
        """Compare a block of the bus with what the lane brought. Raises StreamFault."""
        first, end = header.first_step, header.first_step + len(force)
        if end > self.end:
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} reaches step {end}, the lane brought "
                f"forces of {self.end} steps"
            )
        ours = np.ascontiguousarray(force, np.float64).view(np.int64)
        differs = np.flatnonzero(ours != self.forces[first:end].view(np.int64))
        if len(differs):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} differs from what the lane brought at "
                f"step {first + int(differs[0])}"
            )
        self._confirmed = end

    def all_confirmed(self) -> bool:
        """Whether what the lane brought has all come over the bus, too."""
        return not self.in_lane or self._confirmed == self.end


def controllers_fault(
    port: Port, checker: SequenceChecker, timeout_s: float
) -> EndedByOther | None:
    """The fault with which the controller is about to end, if it is: forces that it still published
    then need not have got into the lane."""
    with suppress(BusError, StreamFault):
        while True:
            envelope = port.receive(min(timeout_s, _NOTICE_S), "the end")
            block = checker.accept(envelope)
            if envelope.stream == "end/controller":
                fault = block.header.fault
                return EndedByOther(f"the controller ended the run: {fault}") if fault else None
    return None


def refusal(said: int, answers: ForceBuffer) -> str:
    """What is wrong with an answer in the lane, in a sentence."""
    record, step = int(answers.lane.own[TAKEN]) - 1, answers.end
    what = {
        GAP: "has another number than was expected",
        WRONG_COUNT: "answers samples that were not sent, or fewer than before",
        BEYOND_END: f"holds a force beyond the run's {len(answers.forces)} steps",
        NO_NUMBER: "holds a number that is infinite",
        BROKEN_PROMISE: f"breaks the promise of zero force in step {step}, which is over",
    }
    return f"answer {record} in the lane {what[said]}"


@dataclass(frozen=True)
class Repeat:
    """What is repeated: the run's number, its forces (N, one a step), and by how many steps the one
    that acted in each was too old; None of a run in lock-step."""

    path: Path
    run_id: int
    forces: np.ndarray
    held: np.ndarray | None

    @property
    def commands(self) -> np.ndarray:
        """What acted in each step, N."""
        if self.held is None:
            return self.forces
        return np.asarray(self.forces[np.arange(len(self.forces)) - self.held])

    def compare(self, forces: np.ndarray) -> None:
        """Raise StreamFault unless the controller's forces are the recorded ones, bit for bit."""
        differs = np.flatnonzero(forces.view(np.int64) != self.forces.view(np.int64))
        if len(differs):
            at = int(differs[0])
            raise StreamFault(
                f"the controller's force of step {at} is {float(forces[at])!r} N, that in "
                f"{self.path} {float(self.forces[at])!r} N: this is not the same run"
            )


def repeat_of(recording: Recording) -> Repeat:
    """What is to be repeated of a recording. Raises UnreadableRecording if it is not whole."""
    if recording.problems:
        raise UnreadableRecording(
            f"{recording.path} cannot be repeated because it is incomplete: {recording.problems[0]}"
        )
    forces = np.array(recording.force.arrays["force_n"])
    held = recording.truth.arrays.get("held_steps")
    if held is not None:
        held = np.array(held)
        if len(held) != len(forces) or np.any(held < 0) or np.any(held > np.arange(len(held))):
            raise UnreadableRecording(
                f"{recording.path} cannot be repeated: held_steps of stream 'truth' names forces "
                "before the run"
            )
    return Repeat(recording.path, int(recording.metadata["run_id"], 16), forces, held)


class LaneOffer:
    """Offers a lane in `hello`; `became` is the name of the controller's LaneAnswer, "" if none was
    offered."""

    def __init__(
        self, hello: Hello, run_id: int, every_steps: int, answers: ForceBuffer, timeout_s: float
    ) -> None:
        self.became = ""
        self._answers, self._timeout_s = answers, timeout_s
        self._segment: Segment | None = None
        self._quiet = (-1, 0.0)  # samples that were answered in the lane, and since when
        try:
            self._segment = Segment(run_id, hello.steps, every_steps)
        except OSError:  # no such memory here
            return
        self.became = LaneAnswer.Name(LaneAnswer.NOT_STATED)
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
        if said > SILENT:
            raise StreamFault(refusal(said, self._answers))
        if said == SILENT:
            seen, now = self._answers.samples, clock.now()
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


class LaneController:
    """Answers through one end of a lane, kept until they are published, too."""

    def __init__(self, controller: Controller, end: lane_kernels.Lane, look_ahead: bool) -> None:
        """From what the controller has answered until now."""
        self._controller, self._end, self._look_ahead = controller, end, look_ahead
        self.total = len(controller.law_state.history)
        self.idle_s = 0.0  # for which no sample has come
        self._modes, self._delays = (np.zeros(_ROOM, np.int64) for _ in range(2))
        self._first = self._confirmed = self.samples  # not published yet; compared with the bus
        self._first_step = int(controller.line_state.counts[EMITTED])
        end.own[FORCES_PUT] = self._first_step
        end.own[SAMPLES_PUT] = self._first
        self._heard: list[tuple[int, int, np.ndarray]] = []  # daq: sequence, first sample, values
        self._since = clock.now()

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
        said = loop_kernels.serve(
            controller.law, controller.law_state, controller.line, controller.line_state,
            controller.forces, self._modes, self._delays, self._end, self._first,
            min(limit, self._first + _ROOM), self._look_ahead,
        )  # fmt: skip
        try:
            controller.check()
        except LawFault as error:
            raise StreamFault(str(error)) from error
        if said == GAP:
            raise StreamFault(f"sample {self.samples} is missing in the lane")
        if said == NO_NUMBER:
            raise StreamFault(f"sample {self.samples} in the lane is no finite number")
        now = clock.now()
        if said != SILENT or self.samples != before:
            self._since = now
        self.idle_s = now - self._since
        self._confirm()

    def reply(self) -> Reply:
        """What was answered since the last call."""
        controller, first, first_step = self._controller, self._first, self._first_step
        count, end = self.samples - first, int(controller.line_state.counts[EMITTED])
        level = float(laws.quiet_level(controller.law, controller.law_state))
        promises = level < math.inf and bool(controller_kernels.is_quiet(controller.line_state))
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
