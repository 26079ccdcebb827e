"""Attacks on the bus of a run at random moments, and what comes of them, as a table.

`python -m tests.faults.attacks --tries 60 --seed 1`: in every try, plant, controller and recorder
are `hertzloop node` processes that meet at open ports of this machine. The plant or the controller
says something wrong once (`tests.faults.liar`), or a stranger, who knows the ports and the name of
the run, says or hears as it likes.

After it, all honest roles end soon, with exit code 1, and the sentence of one of them names the
wrong stream; the recording can be read and says that it is not complete.
"""

import multiprocessing
import os
import random
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import zenoh

from hertzloop.bus import codec
from hertzloop.bus.codec import decoded
from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES, STREAMS, Envelope
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.inspection import inspected
from hertzloop.views.run_json import inspection_as_json
from tests.bus.meshes import stranger as linked
from tests.commands import as_options
from tests.elastic_scenes import with_elastic_scenes
from tests.faults.liar import LIED, LIES
from tests.faults.series import NotReached, Outcome, series
from tests.hertzloop.commands import (
    HERTZLOOP,
    Bus,
    grown_to,
    killed_at_the_end,
    wait_for,
)

STRANGER = "other peer"
OBSERVER = "an observer that hangs"
DURATION_S, LONG_S = 0.3, 19.0  # of a run; of one that another peer is to end
TIMEOUT_S, HANGS_S = 4.0, 60.0
UNDER_WAY, MOST_S = 50_000, 0.5  # bytes of a recording; a random time after that
LARGEST_NUMBER = 60  # of a message that is wrong


def plant_words(duration_s: float = DURATION_S) -> list[str]:
    """What is run."""
    settings = as_options([f"run.duration_s={duration_s}", "run.accuracy=0.1"])
    return ["aluminium-3mm", *settings, "--max-exchange-steps", "200"]


@dataclass(frozen=True)
class Attack:
    """Who does what, to which message of a stream, or how long after the run is under way."""

    who: str
    how: str
    stream: str = ""
    number: int = 0
    after_s: float = 0.0
    shared_memory: bool = True


def possible(how: str, stream: str) -> bool:
    """Whether a lie can be told of a stream."""
    fields = STREAMS[stream].message.DESCRIPTOR.fields_by_name
    match how:
        case "messages" | "samples":
            return "count" in fields
        case "other scene":
            return stream in ("hello", "end/controller")
        case "other law":
            return stream == "hello"
        case "not finite":
            return stream in ("daq", "truth", "force")
        case "number":
            return not (STREAMS[stream].numbered or STREAMS[stream].once)
        case "reordered":
            return not STREAMS[stream].once and not stream.startswith("events/")
        case _ if how in ("run_id", "sequence", "first_step", "step_ns", "samples_seen"):
            return how in fields
    return True


def draw(random_: random.Random) -> Attack:
    """Any attack."""
    who, shared = random_.choice([PLANT, CONTROLLER, STRANGER]), random_.random() < 0.5
    if who == STRANGER:
        after_s = random_.uniform(0.0, MOST_S)
        stream = random_.choice([s.name for s in STREAMS.values() if not s.once])
        return Attack(who, random_.choice(list(DEEDS)), stream, 0, after_s, shared)
    how = random_.choice(list(LIES))
    # A paced run alone has the stream of pacing, and a scene with files that of scenes.
    streams = [s.name for s in STREAMS.values() if s.publisher == who]
    streams = [s for s in streams if s not in ("pacing", "scene") and possible(how, s)]
    if not streams:
        return draw(random_)
    stream = random_.choice(streams)
    many = not STREAMS[stream].once and not stream.startswith("events/")
    return Attack(who, how, stream, random_.randrange(LARGEST_NUMBER) * many, 0.0, shared)


class Stranger:
    """A session that belongs to no role, linked to all of them."""

    def __init__(self, bus: Bus, random_: random.Random, stack: ExitStack) -> None:
        self.bus, self.random, self.stack = bus, random_, stack
        self.root = f"hertzloop/{bus.name}"
        self.heard: dict[str, tuple[bytes, bytes | None]] = {}
        self.session = stack.enter_context(linked(*bus.urls.values()))
        self._ears = self.session.declare_subscriber(f"{self.root}/**", self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        stream = str(sample.key_expr).removeprefix(f"{self.root}/")
        number = sample.attachment.to_bytes() if sample.attachment else None
        self.heard[stream] = sample.payload.to_bytes(), number

    def say(self, stream: str, payload: bytes, number: bytes | None = None) -> None:
        """Send a message, and leave it to zenoh when."""
        self.session.put(
            f"{self.root}/{stream}",
            payload,
            attachment=number or bytes(8),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def last(self, stream: str) -> tuple[bytes, bytes | None]:
        """The message that it heard last on a stream. Raises NotReached if there is none."""
        if stream not in self.heard:
            raise NotReached(f"no message on '{stream}'")
        return self.heard[stream]


def _repeat(stranger: Stranger, stream: str) -> None:
    stranger.say(stream, *stranger.last(stream))


def _continue(stranger: Stranger, stream: str) -> None:
    """Say what could be the next message, before who should say it."""
    payload, number = stranger.last(stream)
    header, arrays = decoded(Envelope(stream, payload, 0))
    if hasattr(header, "first_step"):
        header.sequence += 1
        count = max(len(values) for values in arrays.values())
        header.first_step += count * getattr(header, "every_steps", 1)
    after = int.from_bytes(number or b"", "little") + 1
    stranger.say(stream, codec.encode(header, **arrays), after.to_bytes(8, "little"))


def _end(stranger: Stranger, stream: str) -> None:
    role = STREAMS[stream].publisher
    stranger.say(f"end/{role}", RunEnd(role=role).SerializeToString())


def _observer(stranger: Stranger, stream: str) -> None:
    """Hear everything, and then take nothing any more."""
    context = multiprocessing.get_context("spawn")
    begun = context.Event()
    bus = stranger.bus
    process = context.Process(target=_hear_all, args=(bus.name, [*bus.urls.values()], begun))
    process.start()
    stranger.stack.callback(process.kill)
    if not begun.wait(HANGS_S):
        raise NotReached("the observer heard nothing")
    os.kill(process.pid or 0, signal.SIGSTOP)


def _hear_all(name: str, endpoints: list[str], begun: Event) -> None:
    with linked(*endpoints) as session:
        ears = session.declare_subscriber(f"hertzloop/{name}/**", lambda sample: begun.set())
        signal.pause()
        del ears


def _begin(stack: ExitStack, words: list[str], **more: Any) -> subprocess.Popen:
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | more
    process = subprocess.Popen(with_elastic_scenes(words), **quiet)
    stack.enter_context(killed_at_the_end([process]))
    return process


DEEDS: dict[str, Callable[[Stranger, str], None]] = {
    "random bytes": lambda it, stream: it.say(stream, it.random.randbytes(200)),
    "32 MiB": lambda it, stream: it.say(stream, it.random.randbytes(1 << 25)),
    "a message again": _repeat,
    "the next message": _continue,
    "an end": _end,
    OBSERVER: _observer,
}


def attacked(attack: Attack, folder: Path) -> Outcome:
    """Start a run, attack it, and wait for the end. Raises NotReached."""
    bus, recording = Bus(f"attacked-{secrets.token_hex(4)}"), folder / "run.mcap"
    shared = [] if attack.shared_memory else ["--no-shared-memory"]
    words = {
        PLANT: [*plant_words(LONG_S if attack.who == STRANGER else DURATION_S), *shared],
        CONTROLLER: shared,
        RECORDER: ["--out", str(recording)],
    }
    began = time.monotonic()
    with ExitStack() as stack:
        roles = {}
        for role in reversed(ROLES):
            command = ["node", role, *words[role], "--timeout", str(TIMEOUT_S), *bus.words(role)]
            program = HERTZLOOP
            if role == attack.who:
                said = [attack.how, attack.stream, str(attack.number)]
                program = [sys.executable, "-m", "tests.faults.liar", *said]
            process = _begin(stack, [*program, *command], stderr=subprocess.PIPE, text=True)
            roles[role] = process
        if attack.who == STRANGER:
            stranger = Stranger(bus, random.Random(str(attack)), stack)
            wait_for(lambda: _is_over(roles) or grown_to(recording, UNDER_WAY)())
            wait_for(
                lambda: _is_over(roles) or len(stranger.session.info.peers_zid()) == len(ROLES)
            )
            time.sleep(attack.after_s)
            if _is_over(roles):
                raise NotReached("the run was over")
            DEEDS[attack.how](stranger, attack.stream)
        wrong, said = [], {}
        for role, process in roles.items():
            try:
                said[role] = " ".join(process.communicate(timeout=HANGS_S)[1].split())
            except subprocess.TimeoutExpired:
                wrong.append(f"{role} hangs")
        seconds = time.monotonic() - began
        if attack.who != STRANGER and LIED not in said.get(attack.who, LIED):
            raise NotReached("no such message")
        honest = {role: process.poll() for role, process in roles.items() if role != attack.who}
    return _judged(attack, honest, said, recording, Outcome(seconds, str(said), wrong))


def _is_over(roles: dict[str, subprocess.Popen]) -> bool:
    return any(process.poll() is not None for process in roles.values())


def _words(attack: Attack) -> list[str]:
    """Words of which one has to be in a sentence, if the attack ends the run."""
    stream = f"stream '{attack.stream}'"
    return {
        "lost": [stream, "waited"],
        "reordered": [stream, "waited"],
        "other scene": ["scene"],
        "other law": ["law"],
        "messages": ["is incomplete"],
        "samples": ["is incomplete"],
        "an end": [f"stream 'end/{STREAMS[attack.stream].publisher}'"],
        OBSERVER: ["an observer accepted no message"],
    }.get(attack.how, [stream])


def _judged(
    attack: Attack,
    codes: dict[str, int | None],
    said: dict[str, str],
    recording: Path,
    outcome: Outcome,
) -> Outcome:
    for role, words in said.items():
        if "Traceback" in words:
            outcome.wrong.append(f"a traceback of the {role}")
        if words.count("error:") > 1 or (codes.get(role) == 1 and "error:" not in words):
            outcome.wrong.append(f"not one error of the {role}")
    if set(codes.values()) == {0}:
        outcome.wrong.append("not noticed")
    elif set(codes.values()) != {1}:
        outcome.wrong.append(f"exit codes {codes}")
    elif not any(word in str(said) for word in _words(attack)):
        outcome.wrong.append("another cause")
    try:
        if inspection_as_json(inspected(read(recording)))["complete"]:
            outcome.wrong.append("the recording says that it is complete")
    except (RecordingError, OSError) as error:
        if attack.stream != "hello":
            outcome.wrong.append(f"unreadable: {error}")
    return outcome


if __name__ == "__main__":
    sys.exit(series(__doc__, draw, attacked, ("who", "how")))
