"""What the controller has answered so far: forces and promises, from the bus or from the lane."""

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bus import lane, lane_kernels
from bus.messages_pb2 import ForceBlock
from bus.port import BusError, EndedByOther, Port
from bus.streams import Checker, StreamFault
from hertzloop.loop import kernels as k
from hertzloop.setup import Setup
from recordings.reader import Recording
from recordings.writer import RecordingError

_NOTICE_S = 1.0  # in which a controller that fails says so


class Answers:
    """Forces by step, what they reach to, and the lane that may bring them, closed at first."""

    def __init__(self, setup: Setup, window: k.Window, held: np.ndarray | None = None) -> None:
        """`held`: by how many steps the command of a step was too old, where it may be."""
        self.forces = np.zeros(setup.steps)
        self.lane = lane.closed()
        self.grant = k.Grant(
            counts=np.zeros(k.GRANT_COUNTS, np.int64),
            level=np.full(1, math.inf),  # no promise is known yet: any sample breaks it
            lead_steps=1 + setup.line.latency_steps,
        )
        self._window, self._held = window, held
        self._confirmed = 0  # steps whose force came over the bus, too

    @property
    def end(self) -> int:
        """Steps whose force has come, promised ones not counted."""
        return int(self.grant.counts[k.FORCES_END])

    @property
    def samples(self) -> int:
        """Samples that are answered."""
        return int(self.grant.counts[k.SEEN])

    @property
    def in_lane(self) -> bool:
        """Whether the lane brings them."""
        return bool(self.lane.own[lane_kernels.OPEN])

    def through(self, end: lane_kernels.Lane) -> None:
        """From now on the lane brings them."""
        self.lane, self._confirmed = end, self.end
        end.own[lane_kernels.OPEN] = 1

    def missing_at(self, step: int) -> bool:
        """Whether nothing is known of the force of `step`, of which the sample was taken."""
        counts = self.grant.counts
        observed = self._window.counts[k.OBSERVED] > step
        granted = counts[k.PROMISED] or counts[k.GRANTED_END] > step
        return bool(observed and not granted and step < len(self.forces))

    def take(self, header: ForceBlock, force: np.ndarray, step: int) -> None:
        """A block of the bus, at `step`. Raises StreamFault when it cannot be, or breaks what was
        promised before."""
        first, end = header.first_step, header.first_step + len(force)
        sent = int(self._window.counts[k.SAMPLES_FIRST])
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
        counts[k.FORCES_END] = end
        counts[k.SEEN] = header.samples_seen
        counts[k.GRANTED_END] = max(counts[k.GRANTED_END], end)
        # A promise speaks of samples after those seen; it holds if none of the later ones
        # that were already taken broke it.
        same_level = self.grant.level[0] == header.promise_level
        all_seen = header.samples_seen == self._window.counts[k.SAMPLES_END]
        if all_seen or (same_level and header.samples_seen >= counts[k.BROKEN_AT]):
            counts[k.PROMISED] = int(header.promise_zero)
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


def controllers_fault(port: Port, checker: Checker, timeout_s: float) -> EndedByOther | None:
    """The fault with which the controller is about to end, if it is: forces that it still published
    then need not have got into the lane."""
    with suppress(BusError, StreamFault):
        while True:
            envelope = port.receive(min(timeout_s, _NOTICE_S), "the end")
            block = checker.accept(envelope)
            if envelope.stream == "end/controller":
                fault = block.header.fault
                return EndedByOther(f"the controller gave up: {fault}") if fault else None
    return None


def refusal(said: int, answers: Answers) -> str:
    """What is wrong with an answer in the lane, in a sentence."""
    record, step = int(answers.lane.own[lane_kernels.TAKEN]) - 1, answers.end
    what = {
        k.GAP: "has another number than was expected",
        k.WRONG_COUNT: "answers samples that were not sent, or fewer than before",
        k.BEYOND_END: f"holds a force beyond the run's {len(answers.forces)} steps",
        k.NO_NUMBER: "holds a number that is infinite",
        k.BROKEN_PROMISE: f"breaks the promise of zero force in step {step}, which is over",
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
    """What is to be repeated of a recording. Raises RecordingError if it is not whole."""
    if recording.problems:
        raise RecordingError(
            f"{recording.path} cannot be repeated, it is not whole: {recording.problems[0]}"
        )
    forces = np.array(recording.force.arrays["force_n"])
    held = recording.truth.arrays.get("held_steps")
    if held is not None:
        held = np.array(held)
        if len(held) != len(forces) or np.any(held < 0) or np.any(held > np.arange(len(held))):
            raise RecordingError(
                f"{recording.path} cannot be repeated: held_steps of stream 'truth' names forces "
                "before the run"
            )
    return Repeat(recording.path, int(recording.metadata["run_id"], 16), forces, held)
