"""A controller of your own, with zenoh and protobuf, without hertzloop code.

See docs/reference/wire.md.

Before: python -m grpc_tools.protoc -I. --python_out=. messages.proto
"""

import argparse
import json
import math
import queue
import secrets
import sys
import time
import tomllib
from functools import partial

import zenoh
from messages_pb2 import DaqBlock, ForceBlock, Hello, RunEnd

LAW = "own slope threshold 1.0"
IDLE, WATCHING, ACTING = range(3)
KINDS = {"hello": Hello, "daq": DaqBlock, "end/plant": RunEnd}


class SlopeThreshold:
    """kappa s p^(3/2) of the penetration t_a ago, from when the slope of the gap is above v_thr.

    For an ideal actuator: jitter, clock, drop-outs, converter and slew limit are left out.
    """

    def __init__(self, hello):
        scene = tomllib.loads(hello.scene_toml)
        control, self.every = scene["controller"], scene["sensors"]["every_steps"]
        self.gain, self.v_thr = control["kappa"] * hello.stiffness, control["v_thr_m_s"]
        self.sample_s = self.every * (hello.step_ns * 1e-9)
        self.latency = round(control["latency_us"] * 1000 / hello.step_ns)
        self.gaps, self.mode, self.start, self.delay = [], IDLE, 0, 0

    def command(self, gap):
        """Force (N, up on the plate) for the next sample of the gap (m)."""
        i, touches = len(self.gaps), gap <= 0.0
        self.gaps.append(gap)
        if touches and (i == 0 or self.gaps[i - 1] > 0.0):
            self.start = i
        if self.mode != ACTING:
            self.mode = WATCHING if touches else IDLE
        if self.mode == WATCHING and i and (gap - self.gaps[i - 1]) / self.sample_s > self.v_thr:
            self.mode, self.delay = ACTING, i - self.start
        if self.mode != ACTING:
            return 0.0
        earlier = self.gaps[i - self.delay]
        if earlier > 0.0:
            self.mode = WATCHING if touches else IDLE
            return 0.0
        return self.gain * -earlier * math.sqrt(-earlier)


class Controller:
    """Answers what the plant says; `say(stream, message)` publishes."""

    def __init__(self, say):
        self.say = say
        self.hello, self.heard, self.answers, self.first_step, self.over = None, 0, 0, 0, False

    def hear(self, stream, payload):
        message = KINDS[stream].FromString(payload)
        if stream == "hello":
            self.hello, self.law = message, SlopeThreshold(message)
            self.forces = [0.0] * (1 + self.law.latency)  # until the first sample's own force acts
        elif stream == "daq" and message.sequence == self.heard:
            self.answer(message)
        else:
            self.over = True  # the plant's end, or samples that others were lost before
            self.end(message.fault if stream != "daq" else f"samples {self.heard} were lost")

    def answer(self, block):
        for value in block.value or [block.offset + block.scale * code for code in block.code]:
            command = self.law.command(value)
            self.forces += [command] * self.law.every  # it holds until the next one's force acts
        self.heard, seen, steps = self.heard + 1, len(self.law.gaps), self.hello.steps
        known, self.forces = self.forces[: steps - self.first_step], []
        self.say(
            "force",
            ForceBlock(
                run_id=self.hello.run_id,
                sequence=self.answers,
                first_step=self.first_step,
                step_ns=self.hello.step_ns,
                samples_seen=seen,
                force_n=known,
                zero_until_trigger=self.law.mode == IDLE and command == 0.0,
            ),
        )
        self.answers, self.first_step = self.answers + 1, self.first_step + len(known)
        if seen == -(-steps // self.law.every):
            self.end("")

    def end(self, fault):
        """Say once what was sent, and what it was made by."""
        if self.hello:
            end = RunEnd(run_id=self.hello.run_id, role="controller", fault=fault)
            end.count.add(stream="force", messages=self.answers, samples=self.first_step)
            end.report.law = LAW
            self.say("end/controller", end)
            self.hello = None


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--name", default="hertzloop")
    options.add_argument("--listen", default="tcp/127.0.0.1:7451")
    options.add_argument("--connect", default="tcp/127.0.0.1:7450", help="the plant")
    options.add_argument("--wait", type=float, default=60.0, help="s, for the others to begin")
    options.add_argument("--timeout", type=float, default=5.0, help="s, for a message in the run")
    given = options.parse_args()
    config, root = zenoh.Config(), f"hertzloop/{given.name}"
    for key, value in {
        "listen/endpoints": [given.listen],
        "connect/endpoints": [given.connect],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 2},
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 5_000_000,
    }.items():
        config.insert_json5(key, json.dumps(value))
    inbox, there, block = queue.SimpleQueue(), set(), zenoh.CongestionControl.BLOCK

    def on_token(sample):
        what = str(sample.key_expr).removeprefix(f"{root}/")  # alive/<role>/..., complete/recorder
        what = what.split("/")[1] if what.startswith("alive/") else what
        if sample.kind == zenoh.SampleKind.PUT:
            there.add(what)
        elif what != "complete/recorder":
            there.discard(what)
            inbox.put(None)

    def on(key, handler, declare, **more):
        return declare(f"{root}/{key}", zenoh.handlers.Callback(handler, indirect=False), **more)

    def say(stream, message):
        key, payload = f"{root}/{stream}", message.SerializeToString()
        session.put(key, payload, congestion_control=block, express=True)

    with zenoh.open(config) as session:
        controller = Controller(say)
        for stream in KINDS:
            put = partial(lambda stream, s: inbox.put((stream, s.payload.to_bytes())), stream)
            on(stream, put, session.declare_subscriber)
        for tokens in ("alive/*/*", "complete/*"):
            on(tokens, on_token, session.liveliness().declare_subscriber, history=True)
        token = f"{root}/alive/controller/{secrets.token_hex(8)}"
        token = session.liveliness().declare_token(token)  # after the subscribers, and kept
        deadline = time.monotonic() + given.wait
        while not {"plant", "recorder"} <= there:  # the recorder must hear every answer
            if time.monotonic() > deadline:
                sys.exit(f"waited {given.wait:g} s for plant and recorder: not there")
            time.sleep(0.002)
        while not controller.over:
            try:
                heard = inbox.get(timeout=given.timeout if controller.hello else given.wait)
            except queue.Empty:
                sys.exit("nothing came from the plant")
            if heard:
                controller.hear(*heard)
            elif not ({"plant", "recorder"} <= there or "complete/recorder" in there):
                sys.exit("plant or recorder left the run")
        while "recorder" in there:  # until it has heard the end
            time.sleep(0.002)
        token.undeclare()  # not every client is told of a token that goes with its session
        if "complete/recorder" not in there:
            sys.exit("the recording is not complete")


if __name__ == "__main__":
    main()
