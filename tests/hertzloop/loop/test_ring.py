"""Shared memory: checked against the bus, left when it cannot be. Its bits: test_transports."""

import fcntl
import os
import re
import time
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hertzloop.bus import codec, ring_kernels, shared_memory
from hertzloop.bus.messages_pb2 import Hello
from hertzloop.bus.streams import CONTROLLER, PLANT, STREAMS, Envelope
from hertzloop.loop.answering import Answering
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.run_options import Transport
from hertzloop.recordings.compare import first_difference
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.commands import wait_for
from tests.hertzloop.lanes import Pair
from tests.hertzloop.loop.test_transports import VARIANTS, record, scene_of

FEEDBACK = "velocity feedback"


@cache
def over_the_bus() -> dict[str, str]:
    return Pair(scene_of(FEEDBACK), shared_memory=False).run().samples()


def long_scene() -> Setup:
    """Of more samples than the rings have room for, more than once."""
    return load(VARIANTS[FEEDBACK][0], [*VARIANTS[FEEDBACK][1], "run.duration_s=0.01"])


def test_more_samples_than_room(tmp_path, monkeypatch):
    monkeypatch.setattr(shared_memory, "_SLOTS", 2048)
    pair = Pair(long_scene()).run()
    compiled = record(long_scene(), tmp_path / "a.mcap", Transport.COMPILED)
    assert first_difference(pair.recorded(tmp_path / "b.mcap"), compiled) is None
    assert pair.stats.exchanges > 9000  # a force a step was waited for


def test_one_core():
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        pair = Pair(long_scene()).run()
    finally:
        os.sched_setaffinity(0, cores)
    assert pair.plant.exchange.ring.spins == 0
    assert pair.fault == pair.controller_fault == ""


def lane_of_same_run(**how: Any) -> str:
    """Why there is no lane; the run is the same."""
    pair = Pair(scene_of(FEEDBACK), **how).run()
    assert pair.fault == pair.controller_fault == ""
    assert pair.samples() == over_the_bus()
    return pair.stats.shared_memory


def test_without_a_lane_the_run_is_the_same(monkeypatch):
    assert lane_of_same_run(shared_memory=False) == ""
    assert lane_of_same_run(takes_lane=False) == "SWITCHED_OFF"
    hosts = iter(["one", "another"])
    with monkeypatch.context() as patch:
        patch.setattr(shared_memory, "host", lambda: next(hosts))
        assert lane_of_same_run() == "OTHER_HOST"

    def refuse(*_: object) -> int:
        raise OSError("no memory")

    monkeypatch.setattr(os, "memfd_create", refuse)
    assert lane_of_same_run() == ""


@pytest.mark.parametrize("what", ["file", "unsealed", "foreign run", "gone"])
def test_what_is_no_segment_is_not_joined(tmp_path, what):
    pair = Pair(scene_of(FEEDBACK))
    segment = shared_memory.Segment(1, 2, 3)  # of another run
    fds = {"foreign run": segment.fd, "gone": 2**20, "unsealed": os.memfd_create("x")}
    os.ftruncate(fds["unsealed"], shared_memory.segment_bytes(2048))
    with (tmp_path / "file").open("wb") as file:
        file.write(bytes(shared_memory.segment_bytes(2048)))
        fds["file"] = file.fileno()
        pair.plant.streams.hello.shared_memory.fd = fds[what]
        pair.run()
    os.close(fds["unsealed"])
    segment.withdraw()
    assert pair.fault == pair.controller_fault == ""
    assert pair.stats.shared_memory == "NOT_ALLOWED"


def test_nothing_of_it_has_a_name():
    before = set(os.listdir("/dev/shm"))
    segment = shared_memory.Segment(1, 2, 3)
    assert shared_memory.join(Hello(run_id=1, shared_memory=segment.offer))[0] is not None
    assert set(os.listdir("/dev/shm")) <= before
    segment.withdraw()
    assert shared_memory.join(Hello(run_id=1, shared_memory=segment.offer))[0] is None


def test_no_end_can_change_its_size_or_seal_it_further():
    segment = shared_memory.Segment(1, 2, 3)
    size = os.fstat(segment.fd).st_size
    for other in (size - 8, size + 8):
        with pytest.raises(PermissionError):
            os.ftruncate(segment.fd, other)
    with pytest.raises(PermissionError):
        fcntl.fcntl(segment.fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE)
    segment.withdraw()


@pytest.mark.parametrize(("stream", "of"), [("daq", "samples"), ("force", "forces of steps")])
def test_what_the_ring_brought_has_the_checksum_of_the_bus(stream, of):
    pair = Pair(long_scene())

    def alter(envelope: Envelope) -> Envelope:
        if envelope.stream != stream:
            return envelope
        block = codec.decode(STREAMS[stream].message, envelope.payload)
        if not block.header.checksum:
            return envelope
        block.header.checksum ^= 1
        return Envelope(stream, codec.encode(block.header, **block.arrays))

    pair.ports[PLANT if stream == "daq" else CONTROLLER].alter = alter
    pair.run()
    noticed = pair.controller_fault if stream == "daq" else pair.fault
    assert re.search(
        rf"'{stream}' sequence \d+: {of} \d+ to \d+ differ from what the ring", noticed
    )
    assert noticed in pair.fault


@pytest.mark.parametrize(
    ("word", "value", "said"),
    [
        (0, 10**6, "has another number than was expected"),
        (1, 10**6, "answers samples that were not sent"),
        (1, 0, "answers samples that were not sent, or fewer than before"),
        (2, np.inf, "holds a number that is infinite"),
        (3, np.inf, "holds a number that is infinite"),
    ],
)
def test_a_broken_answer_in_the_lane_ends_the_run(word, value, said, monkeypatch):
    pair, spoiled = Pair(long_scene()), list[int]()
    serve = ControllerNode.work

    def spoil(end: ring_kernels.Ring, seen: int) -> None:
        at = int(ring_kernels._answer_slot(end, int(end.own[ring_kernels.TAKEN])))
        end.words[at + 1], end.numbers[at + 2], end.numbers[at + 3] = seen + 1, 0.0, np.nan
        (end.numbers if word > 1 else end.words)[at + word] = value
        if word:
            end.words[at] = end.own[ring_kernels.TAKEN] + 1

    def work(node: ControllerNode, timeout_s: float) -> None:
        if pair.plant.in_ring and node.samples > 2000 and not spoiled:
            # The plant takes all answers, sends a sample and waits for the next; then it sees
            # the spoiled one before the true one takes its place.
            ring = pair.plant.exchange.ring
            wait_for(lambda: pair.plant.answered == node.samples)
            slot = ring_kernels.SAMPLE_WORDS * (node.samples % ring.slots)
            wait_for(lambda: ring.words[ring_kernels.SAMPLE_RING + slot] == node.samples + 1)
            spoil(ring, node.samples)
            spoiled.append(node.samples)
            wait_for(lambda: pair.fault)
        serve(node, timeout_s)

    monkeypatch.setattr(ControllerNode, "work", work)
    assert said in pair.run().fault


@pytest.mark.parametrize("silent", [PLANT, CONTROLLER])
def test_silence_is_named_in_time(silent, monkeypatch):
    pair = Pair(long_scene(), timeout_s=2.0)
    work = ControllerNode.work

    def stop(node: ControllerNode, timeout_s: float) -> None:
        if silent == CONTROLLER and node.samples > 2000:
            wait_for(lambda: pair.fault)
        work(node, timeout_s)

    def pause(step: int) -> None:
        if silent == PLANT and step == 3000:
            wait_for(lambda: pair.controller_fault)

    monkeypatch.setattr(ControllerNode, "work", stop)
    pair.plant.on_progress = pause
    pair.run()
    if silent == CONTROLLER:
        assert "plant waited 2 s for the force for step" in pair.fault
        assert "from the controller: nothing came in the ring" in pair.fault
    else:
        assert "controller waited 2 s for samples from the plant" in pair.controller_fault


@pytest.mark.full
def test_a_slow_run_is_heard_of_all_the_time(monkeypatch):
    """Where a block of steps takes longer than anybody waits. Counted in answers, none of which
    takes less than its delay: a busy machine adds time to them, but no answer."""
    timeout_s, delay_s = 3.0, 0.002
    scene = load(VARIANTS[FEEDBACK][0], [*VARIANTS[FEEDBACK][1], "run.duration_s=0.003"])
    pair, told = Pair(scene, timeout_s=timeout_s), list[int]()
    serve, publish = Answering.answer_in_ring, pair.ports[PLANT].publish

    def slow(answers: Answering, limit: int) -> None:
        if limit > answers.samples:
            time.sleep(delay_s)
        serve(answers, min(limit, answers.samples + 1))

    def tell(envelope: Envelope) -> None:
        told.append(pair.controller.samples)
        publish(envelope)

    monkeypatch.setattr(Answering, "answer_in_ring", slow)
    pair.ports[PLANT].publish = tell  # type: ignore[method-assign]
    pair.run()
    assert pair.fault == pair.controller_fault == ""
    assert told[-1] == 3000
    assert max(b - a for a, b in pairwise(told)) * delay_s < timeout_s / 2
