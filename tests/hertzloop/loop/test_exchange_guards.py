"""The guards of the lock-step: against a controller that breaks its word, against forgeries."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.codec import decoded
from hertzloop.bus.messages_pb2 import RunEnd, StreamCount
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import Envelope, StreamFault
from hertzloop.scene.toml import to_toml
from tests.bus.tapes import changed
from tests.hertzloop.exchange import Alter, exchange, forces
from tests.hertzloop.scenes import aluminium_3mm
from tests.hertzloop.short_runs import SHORT, scene

pytestmark = pytest.mark.usefixtures("short_blocks")
SEEDS = range(2)  # of the delays
STEPS = 2500  # of a run


def refused(words: str | tuple[str, ...], name: str = "law", **how: Any) -> None:
    """Fail unless a run ends with these words, whatever the delays."""
    for seed in SEEDS:
        with pytest.raises(StreamFault) as caught:
            exchange(scene(name), seed, **how)
        for word in [words] if isinstance(words, str) else words:
            assert word in str(caught.value), seed


def on(stream: str, change: Callable[[Envelope], list[Envelope]]) -> Alter:
    """Makes others of the messages of a stream."""
    return lambda envelope: change(envelope) if envelope.stream == stream else [envelope]


def at_the_end(change: Callable[[RunEnd], object], role: str = "controller") -> Alter:
    """Changes the end of a role."""

    def alter(envelope: Envelope) -> list[Envelope]:
        end = RunEnd.FromString(envelope.payload)
        change(end)
        return [replace(envelope, payload=end.SerializeToString())]

    return on(f"end/{role}", alter)


def one_more(stream: str) -> Callable[[RunEnd], None]:
    """Announces a message more than there were."""

    def change(end: RunEnd) -> None:
        next(count for count in end.count if count.stream == stream).messages += 1

    return change


def another_law(end: RunEnd) -> None:
    end.report.scene_toml = end.report.scene_toml.replace("kappa = 0.8", "kappa = -5.0")


def with_last(values: np.ndarray, value: float) -> np.ndarray:
    values[-1:] = value
    return values


def never_grants(header: Any, force: np.ndarray) -> np.ndarray:
    """Answers all samples, but grants and promises nothing."""
    header.first_step, header.zero_until_trigger = 0, False
    return force[:0]


def ends_at_once(envelope: Envelope) -> list[Envelope]:
    if envelope.stream != "force":
        return []
    end = RunEnd(run_id=decoded(envelope).header.run_id, role="controller")
    return [Envelope("end/controller", end.SerializeToString(), 0)]


# What a controller says, and what the plant answers.
BREACHES: dict[str, tuple[Alter, str | tuple[str, ...]]] = {
    "a force where none was promised": (
        forces(lambda header, force: force + 1.0 if header.sequence == 1 else None),
        "in which the force was to stay zero"),
    "forces beyond the end": (
        forces(lambda header, force: np.append(force, 0.0)
               if header.first_step + len(force) == STEPS else None),
        "reaches step 2501, the run has 2500"),
    "nan": (forces(lambda header, force: with_last(force, math.nan)),
            "stream 'force' sequence 0 holds force_n"),
    "a level of nan": (forces(lambda header, force: setattr(header, "trigger_level", math.nan)),
                       "'force' sequence 0 holds trigger_level"),
    "an answer to samples never sent": (
        forces(lambda header, force: setattr(header, "samples_seen", 10**6)),
        ("'force' sequence 0 answers 100", "were sent")),
    "an answer to fewer samples than before": (
        forces(lambda header, force: setattr(header, "samples_seen", 0)
               if header.sequence == 3 else None),
        ("'force' sequence 3 answers 0 samples", "answered before")),
    "no force where one is needed": (forces(never_grants), "but granted no force for step"),
    "an end too early": (ends_at_once, "the controller ended the run: too early"),
    "a force that did not come": (
        at_the_end(one_more("force")), "stream 'force' is incomplete"),
    "another scene": (at_the_end(another_law), ("'kappa = -5.0' where", "'kappa = 0.8'")),
    "another stiffness": (at_the_end(lambda end: setattr(end.report, "stiffness", 1.0)),
                          "the controller worked with a contact stiffness"),
}  # fmt: skip


@pytest.mark.parametrize("name", BREACHES)
def test_a_controller_that_breaks_its_word_ends_the_run(name):
    alter, words = BREACHES[name]
    refused(words, max_exchange_steps=100, alter=alter)


def hello_of_another_law(envelope: Envelope, sequence: int) -> Envelope:
    header = decoded(envelope).header
    header.scene_toml = to_toml(aluminium_3mm(*SHORT, "controller.kappa=-5").scene)
    return Envelope("hello", header.SerializeToString(), sequence)


def samples(change: Callable[[Any, np.ndarray], np.ndarray]) -> Alter:
    """Changes the values of every block of samples."""

    def alter(envelope: Envelope) -> list[Envelope]:
        block = decoded(envelope)
        values = change(block.header, block.arrays["value"].copy())
        return [Envelope("daq", codec.encode(block.header, value=values))]

    return on("daq", alter)


def one_too_many(header: Any, values: np.ndarray) -> np.ndarray:
    return np.append(values, 1.0) if header.first_step + len(values) == STEPS else values


def ends_early(envelope: Envelope) -> list[Envelope]:
    """The plant ends before its first sample; the counts are right."""
    header = decoded(envelope).header
    if header.first_step:
        return [envelope]
    counts = [
        StreamCount(stream="hello", messages=1, samples=1),
        StreamCount(stream="daq"),
        StreamCount(stream="scene"),
    ]
    end = RunEnd(run_id=header.run_id, role="plant", count=counts)
    return [Envelope("end/plant", end.SerializeToString(), 0), envelope]


# What reaches the controller alone, and what it says; the plant hears of it and the run ends.
FORGERIES: dict[str, tuple[Alter, str]] = {
    "a second hello": (
        on("hello", lambda envelope: [envelope, hello_of_another_law(envelope, 1)]),
        "a second message came on stream 'hello'"),
    "another length": (on("hello", lambda envelope: [changed(envelope, steps=2000)]),
                       "the plant announced"),
    "no scene": (on("hello", lambda envelope: [changed(envelope, scene_toml="[plate]")]),
                 "the plant announced"),
    "nan": (samples(lambda header, values: with_last(values, math.nan)),
            "stream 'daq' sequence 0 holds value"),
    "samples beyond the end": (samples(one_too_many), "beyond the run's end"),
    "another rate": (on("daq", lambda envelope: [changed(envelope, every_steps=2)]),
                     "has a sample every 2 steps, the scene every 1"),
    "an end before the last sample": (on("daq", ends_early), "the plant ended after 0 samples"),
}  # fmt: skip


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_to_the_controller_ends_the_run(name):
    forge, sentence = FORGERIES[name]
    refused(("the controller ended the run", sentence), forge=forge)


def test_a_forged_hello_shows_in_what_the_controller_says_at_its_end():
    """In place of the plant's, and in good order."""
    forge = on("hello", lambda envelope: [hello_of_another_law(envelope, 0)])
    refused(("'kappa = -5.0' where", "'kappa = 0.8'"), forge=forge)


def test_codes_that_mean_no_numbers():
    """A finite scale of finite codes, whose product is not."""

    def alter(envelope: Envelope) -> list[Envelope]:
        block = decoded(envelope)
        block.header.scale = 1e308
        codes = np.full(len(block.arrays["code"]), 1000)
        return [Envelope("daq", codec.encode(block.header, code=codes))]

    sentence = "'daq' sequence 0 holds a value that is not finite"
    refused(sentence, name="converters", forge=on("daq", alter))


@pytest.mark.parametrize("stream", ["hello", "daq"])
def test_the_controller_reconciles_all_that_it_heard(stream):
    for seed in SEEDS:
        links = exchange(scene(), seed, forge=at_the_end(one_more(stream), "plant"))
        assert f"stream '{stream}' is incomplete" in links.fault


@pytest.mark.parametrize(
    "forge", [lambda envelope: [replace(envelope, sequence=None)], on("hello", lambda _: [])]
)
def test_a_controller_says_nothing_of_a_run_that_it_does_not_know(forge):
    with pytest.raises((StreamFault, PeerLost)):
        exchange(scene(), 0, forge=forge)
