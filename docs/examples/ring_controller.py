"""The way onto the bus of a controller in C in shared memory: see docs/reference/shared-memory.md.

It answers the plant's first samples itself, hands the segment to ring_controller (beside this file,
or at $RING_CONTROLLER), and publishes the forces that come back in blocks, for the recorder.
"""

import os
import subprocess
import threading
import tomllib
import zlib
from array import array
from pathlib import Path

import own_controller
from messages_pb2 import ForceBlock, SharedMemoryAnswer

LAW = "a share of what it senses, in C"
BLOCK = 1000
PROGRAM = os.environ.get("RING_CONTROLLER", Path(__file__).with_name("ring_controller"))


class Share:
    """kappa times the sample: the same as in C, for the first samples."""

    mode = own_controller.ACTING  # it promises nothing

    def __init__(self, hello):
        scene = tomllib.loads(hello.scene_toml)
        self.kappa, self.every = scene["controller"]["kappa"], scene["sensors"]["every_steps"]
        self.latency = round(scene["controller"]["latency_us"] * 1000 / hello.step_ns)
        self.gaps = []

    def command(self, sensed):
        """Force (N, up on the plate) for the next sample."""
        self.gaps.append(sensed)
        return self.kappa * sensed


class RingController(own_controller.Controller):
    """As over the bus, until the lane is there."""

    lane = None

    def hear(self, stream, payload):
        if self.lane is None or stream != "daq":  # what the lane has brought comes here again
            super().hear(stream, payload)

    def answer(self, block):
        own, joined = self.say, []

        def say(stream, message):
            if stream == "force" and not message.sequence and self.hello.HasField("shared_memory"):
                offer = self.hello.shared_memory
                joined.append(os.open(f"/proc/{offer.pid}/fd/{offer.fd}", os.O_RDWR))
                message.shared_memory = SharedMemoryAnswer.JOINED
            own(stream, message)

        self.say = say
        super().answer(block)
        self.say = own
        if joined and self.hello:  # a run of a single sample is over already
            words = [joined[0], self.hello.run_id, len(self.law.gaps), self.law.latency]
            self.lane = subprocess.Popen(
                [PROGRAM, *map(str, words), repr(self.law.kappa)],
                pass_fds=joined,
                stdout=subprocess.PIPE,
            )
            threading.Thread(target=self.publish, daemon=True).start()

    def publish(self):
        """Forces of the C program, in blocks."""
        while raw := self.lane.stdout.read(8 * BLOCK):
            self.say(
                "force",
                ForceBlock(
                    run_id=self.hello.run_id,
                    sequence=self.answers,
                    first_step=self.first_step,
                    step_ns=self.hello.step_ns,
                    force_n=array("d", raw),
                    checksum=zlib.crc32(raw),
                    samples_seen=max(0, self.first_step + len(raw) // 8 - 1 - self.law.latency)
                    // self.law.every,
                ),
            )
            self.answers, self.first_step = self.answers + 1, self.first_step + len(raw) // 8
        code = self.lane.wait()
        if self.hello:
            self.end("" if code == 0 else f"the controller in C ended with {code}")


own_controller.LAW, own_controller.SlopeThreshold = LAW, Share
own_controller.Controller = RingController

if __name__ == "__main__":
    own_controller.main()
