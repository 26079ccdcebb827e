"""Check a controller process: a scripted plant and a recorder play a run against it.

The rules are those of docs/reference/wire.md. The first broken rule raises Broken with a sentence.
The controller's process is started for each script, or runs already.
"""

import math
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.bus.messages_pb2 import DaqBlock, ForceBlock, RunEnd
from hertzloop.bus.port import BusError, PeerLost, Publisher, new_run_id
from hertzloop.bus.sockets import mesh_endpoints, own_folder
from hertzloop.bus.streams import (
    CONTROLLER,
    PLANT,
    RECORDER,
    STREAMS,
    Checker,
    Envelope,
    MessageError,
    StreamFault,
    decoded,
)
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.controller_node import physical_values
from hertzloop.loop.plant_streams import ROOM_STEPS, announce, hello
from hertzloop.processes.program import filled_in
from hertzloop.recordings.recording import Recording
from hertzloop.setup import Setup, load, parse
from hertzloop.setup.build import build_sensor
from hertzloop.setup.controller import build_controller

_SCENE = "aluminium-3mm"
_SPEED_M_S = 1.0
_LOWEST_M = -9e-6  # of the deepest contact; the converter's range is stretched to what it needs
_LONG_STEPS = 20_000  # beyond which an exchange a step would take minutes


@dataclass(frozen=True)
class Script:
    """A run as the plant plays it, whatever forces come.

    `samples` are codes of a converter or values, with a flag each in `clipped`; `ending` is
    "whole", "fault" (the plant gives up half way and says so) or "death" (it leaves half way).
    `late_end`: the plant's end comes after the recorder has confirmed its completion and left, as
    it may, since the two are on different links.
    `expected`: the force of every step (N), where `expected_of` says whose.
    """

    name: str
    setup: Setup
    samples: np.ndarray
    clipped: np.ndarray
    scale: float = 0.0
    offset: float = 0.0
    stiffness: float = 0.0
    ending: str = "whole"
    late_recorder: bool = False
    late_end: bool = False
    horizons: tuple[int | None, ...] = (1, None)
    expected: np.ndarray | None = None
    expected_of: str = ""

    @property
    def lead_steps(self) -> int:
        """The force of a sample at step k acts from step k + lead_steps on."""
        return 1 + self.setup.line.latency_steps

    def values(self) -> np.ndarray:
        """The samples in the unit of their quantity."""
        codes = self.samples.dtype.kind == "i"
        return physical_values(self.samples, self.scale, self.offset) if codes else self.samples


def gap_m(steps: int, contacts: Sequence[tuple[int, int]]) -> np.ndarray:
    """A gap in free flight (m) with half sines of contact, (first step, length) each.

    No value is zero exactly, nor are two the same: laws that differ in the last bit show it.
    """
    at = np.arange(steps)
    away = [np.where(at < one, one - at, at - one - length + 1) for one, length in contacts]
    gap = np.min(away, axis=0) * 1e-6 * _SPEED_M_S
    for first, length in contacts:
        phase = np.pi * (np.arange(length) + 0.5) / length
        gap[first : first + length] = _LOWEST_M * (length / 29.0) * np.sin(phase)
    return gap * (1.0 + 1e-7 * np.cos(at))


def _script(
    name: str, steps: int, contacts: Sequence[tuple[int, int]], settings: Sequence[str]
) -> Script:
    """A script from a gap; raises SceneError for a law or setting that cannot be."""
    duration = f"run.duration_s={steps * 1e-6:.9f}"
    fixed = (duration, "run.lead_in_s=0", "run.accuracy=0.1", "run.plate_model=modal")
    setup = load(_SCENE, [*settings, *fixed]).with_name(f"conformance-{name}")
    values = gap_m(steps, contacts)[:: setup.every_steps]
    model = build_sensor(setup).model
    flags = np.zeros(len(values), np.uint8)
    script = Script(
        name, setup, values, flags, model.scale, model.offset,
        setup.plant.contact.stiffness,
    )  # fmt: skip
    if model.ideal:
        return script
    # Stretched so that the deepest contact, or the largest force, leaves the converter's range.
    values *= 1.3 * (model.low if model.low < 0.0 else model.high) / values.min()
    flags[:] = (values < model.low) | (values > model.high)
    values = np.clip(values, model.low, model.high)
    codes = np.floor((values - model.offset) / model.scale + 0.5).astype(np.int64)
    return replace(script, samples=np.clip(codes, model.first_code, model.last_code))


def scripts(law: str | None = None, settings: Sequence[str] = ()) -> list[Script]:
    """All scripts, in the order in which they are played, `settings` applied to their scenes;
    with a law its forces are expected.

    Raises SceneError for a law or setting that is none.
    """
    bouncing = [(40, 29), (130, 17), (190, 9), (203, 5)]
    asked = (*settings, *([f"controller.law={law}"] if law else []))
    made = [
        _script("touch", 160, bouncing[:1], asked),
        _script("bounce", 400, bouncing, ("controller.latency_us=5", *asked)),
        _script(
            "saturation", 300, bouncing, ("sensors.bits=8", "sensors.full_scale=contact", *asked)
        ),
        _script(
            "every-third",
            400,
            bouncing,
            ("sensors.every_steps=3", "controller.latency_us=4", *asked),
        ),
        replace(
            _script("late-recorder", 160, bouncing[:1], asked), late_recorder=True, horizons=(None,)
        ),
        replace(_script("late-end", 160, bouncing[:1], asked), late_end=True, horizons=(None,)),
        replace(_script("fault", 300, bouncing, asked), ending="fault", horizons=(None,)),
        replace(_script("death", 300, bouncing, asked), ending="death", horizons=(None,)),
    ]
    return [_with_law(script, law) for script in made] if law else made


def _with_law(script: Script, law: str) -> Script:
    """The script with the forces that our own law of this name answers to it."""
    answering = build_controller(script.setup)
    answering.process(script.values())
    return replace(script, expected=answering.forces.copy(), expected_of=f"law '{law}'")


def recorded(recording: Recording) -> Script:
    """The samples and forces of a recording. Raises ValueError if it is not whole, SceneError if
    its scene cannot be read."""
    if recording.problems:
        raise ValueError(f"{recording.path} is not whole: {recording.problems[0]}")
    setup, daq = parse(recording.scene_toml), recording.daq
    codes = daq.arrays.get("code")
    samples = daq.arrays["value"] if codes is None else codes.astype(np.int64)
    flags = daq.arrays.get("saturated", np.zeros(len(samples), np.uint8))
    told = recording.ends["controller"].set_up.stiffness  # not by controllers of older versions
    return Script(
        name=setup.name,
        setup=setup,
        samples=samples,
        clipped=flags,
        scale=daq.scale,
        offset=daq.offset,
        stiffness=told or setup.plant.contact.stiffness,
        horizons=(1, None) if setup.steps <= _LONG_STEPS else (None,),
        expected=recording.force.arrays["force_n"],
        expected_of=str(recording.path),
    )


_LATE_S = 0.3  # that the recorder comes after the first samples, or the plant's end after it left
_LEAVES_S = 5.0  # at most, after a run; longer where an answer may take longer
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
            header: Any = decoded(envelope).header
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
        announce(self.publisher, self.script.setup, self.hello)
        last = self.steps if self.script.ending == "whole" else self.steps // 2
        exchanged = 0
        for step in range(last):
            self._observe(step)
            waiting = self._samples_by(step) - self.sent
            due = step + 1 >= exchanged + self.horizon or step == self.steps - 1
            due = due or waiting == ROOM_STEPS
            if waiting > 0 and (due or not self._knows(step)):
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
        while self.seen < self.sent:
            envelope = self.port.receive(
                self.timeout_s,
                f"the answer to sample {self.sent - 1} (step {step}) from the controller",
                [CONTROLLER],
            )
            block = self.ear.accept(envelope)
            if isinstance(block.header, RunEnd):
                self._gave_up(block.header)
            self._take(block.header, block.arrays["force_n"])

    def _gave_up(self, end: RunEnd) -> None:
        why = f"with the fault '{end.fault}'" if end.fault else "without a fault"
        raise Broken(f"the controller ended {why} after {self.seen} of {len(self.values)} samples")

    def _take(self, header: ForceBlock, force: np.ndarray) -> None:
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
        envelope = self.port.receive(self.timeout_s, "the controller's end", [CONTROLLER])
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
        end = self.ear.accept(
            self.port.receive(self.timeout_s, "the controller's end", [CONTROLLER])
        ).header
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
            envelope = self.port.receive(left, "the controller's end", [CONTROLLER])
            if STREAMS[envelope.stream].publisher == CONTROLLER:
                self.ear.accept(envelope)
            elif envelope.stream == "hello":
                self.ear.checker.accept(envelope)
        for stream, payloads in plant.ear.heard.items():
            self.checks.that(
                self.ear.heard.get(stream) == payloads,
                f"the recorder received other bytes on stream '{stream}' than the plant",
            )


@dataclass(frozen=True)
class Meeting:
    """Where the controller is met: the run's name, endpoints of plant, controller and recorder, the
    longest waits (s) for an answer and for the controller to appear."""

    name: str
    endpoints: Sequence[str]
    timeout_s: float
    wait_s: float

    @property
    def leaves_s(self) -> float:
        """Longest time (s) for the controller to leave."""
        return max(_LEAVES_S, self.timeout_s)

    def open(self, role: str) -> ZenohPort:
        """Join the bus. Raises BusError."""
        listen, connect = mesh_endpoints(role, self.endpoints)
        return ZenohPort(role, self.name, listen, connect, patience_s=self.timeout_s)


class _Process:
    """The controller's process, if it is ours to start; ended whatever happens."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self._stderr = folder / "stderr"
        with self._stderr.open("w") as sink:
            self._process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=sink
            )

    def code(self, timeout_s: float) -> int | None:
        """Its exit code; None while it runs on."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def last_words(self) -> str:
        """How it ended, for a sentence; "" while it runs."""
        code = self.code(1.0)
        if code is None:
            return ""
        return f" (its process ended with exit code {code}{self.said() or ': nothing said'})"

    def said(self) -> str:
        """The last line of its stderr, for a sentence; "" if there is none."""
        lines = self._stderr.read_text(errors="replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    def end(self) -> None:
        if self._process.poll() is None:
            self._process.terminate()
            if self.code(2.0) is None:
                self._process.kill()
                self._process.wait()


@contextmanager
def _started(words: list[str]) -> Iterator[_Process | None]:
    """The process of a command line, or none without one. Raises OSError."""
    if not words:
        yield None
        return
    with own_folder() as folder:
        process = _Process(words, Path(folder))
        try:
            yield process
        finally:
            process.end()


def play(
    script: Script, horizon: int | None, meeting: Meeting, command: str, checks: Checks
) -> ScriptedPlant:
    """One run. `command`: the controller's command line, "" if it runs already.

    Raises Broken with the first thing that is wrong, OSError if the command line cannot be
    started.
    """
    ports: dict[str, ZenohPort] = {}
    try:
        ports[PLANT] = meeting.open(PLANT)  # first: not every program tries to connect again
        with _started(filled_in(command, meeting.name, meeting.endpoints)) as process:
            return _play(script, horizon, meeting, ports, process, checks)
    except BusError as error:
        raise Broken(str(error)) from error
    finally:
        for port in ports.values():
            port.close()


def _play(
    script: Script,
    horizon: int | None,
    meeting: Meeting,
    ports: dict[str, ZenohPort],
    process: _Process | None,
    checks: Checks,
) -> ScriptedPlant:
    try:
        plant = ScriptedPlant(script, ports[PLANT], horizon, meeting.timeout_s, checks)

        def recorder_comes() -> None:
            if RECORDER in ports:
                return
            time.sleep(_LATE_S)
            ports[RECORDER] = meeting.open(RECORDER)
            ports[RECORDER].presence.announce()

        if not script.late_recorder:
            recorder_comes()
        ports[PLANT].presence.announce()
        awaited = [CONTROLLER] if script.late_recorder else [CONTROLLER, RECORDER]
        _await(ports[PLANT], awaited, meeting.wait_s, process)
        others = ports[PLANT].other_subscribers()
        checks.that(
            not others,
            f"the controller's zenoh id {' '.join(others)} is none that a controller of run "
            f"'{meeting.name}' takes: samples that it does not take in time would be dropped",
        )
        plant.play(recorder_comes)
        if script.ending == "fault":
            plant.give_up()
        if script.ending != "death":
            Listener(ports[RECORDER], meeting.timeout_s, checks).hear(plant)
        _leave(script, plant, ports, meeting.leaves_s, process, checks)
        return plant
    except BusError as error:  # it is gone, or silent: before we go, too, it may say why
        raise Broken(f"{error}{process.last_words() if process else ''}") from error


def _await(port: ZenohPort, roles: list[str], wait_s: float, process: _Process | None) -> None:
    """Wait for the others, as long as the controller's process lives. Raises BusError."""
    deadline = time.monotonic() + wait_s
    while True:
        try:
            return port.presence.wait_for(roles, 0.2)
        except PeerLost:
            if process and process.code(0.0) is not None:
                raise Broken(f"the controller did not connect{process.last_words()}") from None
            if time.monotonic() > deadline:
                raise Broken(
                    f"no controller connected to bus '{port.name}' within {wait_s:g} s"
                ) from None


def _leave(
    script: Script,
    plant: ScriptedPlant,
    ports: dict[str, ZenohPort],
    within_s: float,
    process: _Process | None,
    checks: Checks,
) -> None:
    """The plant ends, or is suddenly gone; the controller has to go as well."""
    dies = script.ending == "death"
    if not (dies or script.late_end):
        plant.publisher.end()  # once: after a fault it was said already
    if script.ending == "whole":
        ports[RECORDER].presence.confirm_completion()
    # Whoever is left sees the controller go: the recorder after a death, else the plant.
    ports.pop(PLANT if dies else RECORDER).close()
    if script.late_end:
        time.sleep(_LATE_S)
        plant.publisher.end()
    observer = ports[RECORDER if dies else PLANT]
    why = "the plant has died" if dies else "the run has ended and the recorder left"
    checks.that(
        observer.presence.wait_until_gone(CONTROLLER, within_s),
        f"the controller is still there {within_s:g} s after {why}",
    )
    if process:
        code = process.code(within_s)
        checks.that(code is not None, f"the controller's process runs on after {why}")
        checks.that(
            code == 0 or script.ending != "whole",
            lambda: (
                f"the controller's process ended with exit code {code} after a run without fault"
                f"{process.said()}"
            ),
        )
