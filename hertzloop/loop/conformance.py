"""A scripted plant and its recorder: what they check of a controller, rule by rule.

The rules are those of docs/wire.md. The first that is broken raises Broken with a sentence.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bus.messages_pb2 import DaqBlock, ForceBlock, RunEnd
from bus.port import Publisher
from bus.streams import CONTROLLER, PLANT, STREAMS, Checker, Envelope, StreamFault, decode
from bus.wire import MessageError
from bus.zenoh_port import ZenohPort
from hertzloop.loop.conformance_scripts import Script
from hertzloop.loop.hello import hello, new_run_id

FAULT = "the script ends here, by a fault"
_NEEDED = {"force": ("run_id", "step_ns"), "end/controller": ("run_id", "role")}


class Broken(RuntimeError):
    """The controller broke a rule; the sentence says which, and where first."""


class Checks:
    """Counts what was looked at."""

    def __init__(self) -> None:
        self.count = 0

    def that(self, holds: bool | np.bool_, sentence: Callable[[], str] | str) -> None:
        """One check. Raises Broken."""
        self.count += 1
        if not holds:
            raise Broken(sentence if isinstance(sentence, str) else sentence())


class _Ear:
    """Takes a controller's messages at one role: decoded, complete, in order."""

    def __init__(self, checker: Checker, checks: Checks) -> None:
        self.checker, self.checks = checker, checks
        self.heard: dict[str, list[bytes]] = {}

    def accept(self, envelope: Envelope) -> Any:
        """The decoded block. Raises Broken."""
        name = envelope.stream
        try:
            header: Any = decode(envelope).header
            for field in _NEEDED.get(name, ()):
                number = len(self.heard.get(name, ()))
                self.checks.that(
                    bool(getattr(header, field)),
                    f"stream '{name}' sequence {number} has no field {field}",
                )
        except MessageError:
            pass  # the checker says the same with more words
        try:
            block = self.checker.accept(envelope)
            if name == "end/controller":
                self.checker.reconcile(block.header)
        except StreamFault as error:
            raise Broken(str(error)) from error
        self.checks.count += 1
        self.heard.setdefault(name, []).append(envelope.payload)
        return block


class ScriptedPlant:
    """Plays a script in lock-step, as the plant does, and checks every answer.

    `horizon`: most steps between two exchanges; None for as many as the controller grants.
    """

    def __init__(
        self, script: Script, port: ZenohPort, horizon: int | None, timeout_s: float, checks: Checks
    ) -> None:
        self.script, self.port, self.checks = script, port, checks
        self.horizon, self.timeout_s = horizon or math.inf, timeout_s
        self.publisher = Publisher(port, new_run_id())
        self.hello = hello(script.setup, script.stiffness)
        self.hello.run_id = self.publisher.run_id
        self.steps, self.every = script.setup.steps, script.setup.every_steps
        checker = Checker(self.publisher.run_id, script.setup.step_ns, PLANT, self.hello)
        self.ear = _Ear(checker, checks)
        self.forces = np.zeros(self.steps)
        self.forces_end = self.sent = self.seen = 0
        self.promised, self.level = False, math.inf
        self.zero_end = 0  # steps before this one, unless granted earlier, were promised no force
        self.values = script.values()
        self.end: RunEnd | None = None

    def play(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """All that the plant says, and what it has to hear. `meanwhile` is called after the first
        samples. Raises Broken or PeerLost."""
        self.publisher.send("hello", self.hello)
        last = self.steps if self.script.ending == "whole" else self.steps // 2
        exchanged = 0
        for step in range(last):
            self._observe(step)
            due = step + 1 >= exchanged + self.horizon or step == self.steps - 1
            if self._samples_by(step) > self.sent and (due or not self._knows(step)):
                first, exchanged = not self.sent, step + 1
                self._send(step)
                if first:
                    meanwhile()
                self._hear_answers(step)
            self.checks.that(
                self._knows(step),
                f"the controller has answered all {self.seen} samples, but granted no force for "
                f"step {step}",
            )
        if last == self.steps:
            self._hear_answers(last)
            self._hear_end()

    def _samples_by(self, step: int) -> int:
        return step // self.every + 1

    def _knows(self, step: int) -> bool:
        """Whether the force of a step is given or promised."""
        return self.promised or step < max(self.forces_end, self.zero_end)

    def _observe(self, step: int) -> None:
        """What the promise says of a sample: above the level it leads to no force, whether the
        plant was ahead or not; the first one that is not ends the promise, for its own force."""
        if step % self.every or not self.promised:
            return
        self.promised = bool(self.values[step // self.every] > self.level)
        own = step + self.script.lead_steps  # the first step in which this sample's force acts
        self.zero_end = max(self.zero_end, own + self.every if self.promised else own)

    def _send(self, step: int) -> None:
        """The samples up to `step` that were not sent yet."""
        end = self._samples_by(step)
        part, script = slice(self.sent, end), self.script
        quantised = script.samples.dtype.kind == "i"
        header = DaqBlock(
            first_step=self.sent * self.every,
            step_ns=script.setup.step_ns,
            every_steps=self.every,
            scale=script.scale,
            offset=script.offset,
            saturated=script.clipped[part].tobytes() if quantised else b"",
        )
        samples = {"code" if quantised else "value": script.samples[part]}
        self.publisher.send("daq", header, samples)
        self.sent = end

    def _hear_answers(self, step: int) -> None:
        """Wait until all samples sent are answered."""
        while self.seen < self.sent:
            envelope = self.port.receive(
                self.timeout_s,
                f"the answer to sample {self.sent - 1} (step {step}) from the controller",
            )
            block = self.ear.accept(envelope)
            if isinstance(block.header, RunEnd):
                self._gave_up(block.header)
            self._take(block.header, block.arrays["force_n"])

    def _gave_up(self, end: RunEnd) -> None:
        why = f"with the fault '{end.fault}'" if end.fault else "without a fault"
        raise Broken(f"the controller ended {why} after {self.seen} of {len(self.values)} samples")

    def _take(self, header: ForceBlock, force: np.ndarray) -> None:
        """One block of forces and what it promises."""
        that = self.checks.that
        name = f"stream 'force' sequence {header.sequence}"
        first, end, seen = header.first_step, header.first_step + len(force), header.samples_seen
        that(end <= self.steps, f"{name} reaches step {end}, the run has {self.steps}")
        that(
            self.seen <= seen <= self.sent,
            f"{name} has samples_seen = {seen}, {self.sent} were sent and {self.seen} answered "
            "before",
        )
        due = min(seen * self.every + self.script.lead_steps, self.steps) if seen else 0
        that(
            end >= due,
            f"{name} ends before step {end}; after {seen} samples the forces before step {due} "
            "are known: the next sample's force acts from there on",
        )
        zero = force[: max(self.zero_end - first, 0)]
        pushes = np.flatnonzero(zero)
        that(
            not len(pushes),
            lambda: (
                f"{name} breaks the promise of zero force: {zero[pushes[0]]:g} N at step "
                f"{first + pushes[0]}, all samples before were above the level {self.level:g}"
            ),
        )
        self._compare(name, first, force)
        self.forces[first:end] = force
        self.forces_end, self.seen = end, seen
        if seen == self.sent:
            self.promised, self.level = header.promise_zero, header.promise_level

    def _compare(self, name: str, first: int, force: np.ndarray) -> None:
        """The same bytes as expected, if any are."""
        expected = self.script.expected
        if expected is None:
            return
        own = np.ascontiguousarray(expected[first : first + len(force)])
        other = np.flatnonzero(own.view(np.int64) != np.ascontiguousarray(force).view(np.int64))
        self.checks.that(
            not len(other),
            lambda: (
                f"{name}: the force of step {first + other[0]} is {float(force[other[0]])!r} N "
                f"({force[other[0] : other[0] + 1].tobytes().hex()}), of {self.script.expected_of} "
                f"{float(own[other[0]])!r} N ({own[other[0] : other[0] + 1].tobytes().hex()})"
            ),
        )

    def _hear_end(self) -> None:
        """After its last answer comes the controller's end, and nothing else."""
        envelope = self.port.receive(self.timeout_s, "the controller's end")
        self.checks.that(
            envelope.stream == "end/controller",
            "the controller sent another block of forces after all samples were answered",
        )
        self.end = self.ear.accept(envelope).header
        if self.end.fault:
            self._gave_up(self.end)

    def give_up(self) -> None:
        """End by a fault: the controller ends, too, and says why."""
        self.publisher.end(fault=FAULT)
        end = self.ear.accept(self.port.receive(self.timeout_s, "the controller's end")).header
        self.checks.that(
            isinstance(end, RunEnd) and bool(end.fault),
            "the plant ended with a fault, the controller's end has none: such a run is not whole",
        )


class Listener:
    """The recorder: it has to hear all that the plant hears, byte for byte."""

    def __init__(self, port: ZenohPort, timeout_s: float, checks: Checks) -> None:
        self.port, self.timeout_s, self.checks = port, timeout_s, checks
        self.ear = _Ear(Checker(), checks)

    def hear(self, plant: ScriptedPlant) -> None:
        """Everything up to the controller's end. Raises Broken or PeerLost."""
        deadline = time.monotonic() + self.timeout_s
        while "end/controller" not in self.ear.heard:
            left = max(deadline - time.monotonic(), 0.0)
            envelope = self.port.receive(left, "the controller's end")
            if STREAMS[envelope.stream].publisher == CONTROLLER:
                self.ear.accept(envelope)
            elif envelope.stream == "hello":
                self.ear.checker.accept(envelope)
        for stream, payloads in plant.ear.heard.items():
            self.checks.that(
                self.ear.heard.get(stream) == payloads,
                f"the recorder heard other bytes on stream '{stream}' than the plant",
            )
