"""The checker: anything that does not continue its stream is named, with its number."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import EnergyBalance, Event, ForceBlock, RunEnd, TruthBlock
from hertzloop.bus.port import Publisher
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import (
    CONTROLLER,
    PLANT,
    SUBSCRIPTIONS,
    Envelope,
    StreamFault,
)
from tests.bus.tapes import RUN, Tape, changed, places, plant_says


def feed(sent: Sequence[Envelope]) -> SequenceChecker:
    """The checker after all messages; every end is reconciled."""
    checker = SequenceChecker()
    for envelope in sent:
        block = checker.accept(envelope)
        if isinstance(block.header, RunEnd):
            checker.reconcile(block.header)
    return checker


def refused(sent: Sequence[Envelope], *words: str) -> None:
    """The messages raise a fault that names all the words (patterns)."""
    with pytest.raises(StreamFault) as caught:
        feed(sent)
    for word in words:
        assert re.search(word, str(caught.value)), str(caught.value)


@pytest.mark.parametrize("every_steps", [1, 3])
def test_a_whole_run_passes(every_steps):
    checker = feed(plant_says(every_steps=every_steps))
    counts = {name: (c.messages, c.samples) for name, c in checker.counters.items()}
    assert counts == {
        "hello": (1, 1),
        "daq": (3, 12),
        "truth": (3, 12 * every_steps),
        "events/plant": (3, 3),
        "balance": (1, 1),
        "end/plant": (1, 1),
    }


@pytest.mark.parametrize(
    ("stream", "place", "fields", "words"),
    [
        ("daq", 1, {"run_id": 0}, ["belongs to run 0"]),
        ("daq", 1, {"first_step": 3}, ["starts at step 3", "expected 4"]),
        ("daq", 0, {"step_ns": 500}, ["500 ns", "announced were 1000 ns"]),
        # Samples of one stream have one scale: a reader takes it from the first block.
        ("daq", 2, {"every_steps": 2}, ["every_steps"]),
        ("daq", 2, {"scale": 0.25}, ["scale"]),
        ("daq", 0, {"every_steps": 0}, ["every_steps"]),
        ("daq", 1, {"saturated": bytes(3)}, ["3 flags for 4 samples"]),
    ],
)
def test_a_block_that_does_not_fit_its_run(stream, place, fields, words):
    sent = plant_says()
    at = places(sent, stream)[place]
    sent[at] = changed(sent[at], **fields)
    refused(sent, f"stream '{stream}' sequence {place}", *words)


def spoilt(stream: str, fault: str) -> list[Envelope]:
    """A run in which one stream does not count its messages rightly."""
    sent = plant_says()
    at = places(sent, stream)
    if fault == "gap":
        del sent[at[1]]
    elif fault == "lost tail":
        del sent[at[-1]]
    elif fault == "repeat":
        sent.insert(at[-1], sent[at[-1]])
    elif fault == "malformed":
        sent[at[1]] = replace(sent[at[1]], payload=sent[at[1]].payload[:-1])
    elif fault == "no number":
        sent[at[0]] = replace(sent[at[0]], sequence=None)
    else:  # numbered as if it continued the stream
        sent.insert(at[0] + 1, replace(sent[at[0]], sequence=1))
    return sent


@pytest.mark.parametrize(
    ("fault", "streams", "words"),
    [
        ("gap", ["daq", "truth", "events/plant"],
         ["gap on stream '{}'", "sequence 2 came", "1 was expected"]),
        ("repeat", ["daq", "truth", "events/plant"],
         ["repeat on stream '{}'", "sequence 2 came", "3 was expected"]),
        ("repeat", ["hello", "balance"],
         ["repeat on stream '{}'", "sequence 0 came", "1 was expected"]),
        # All that came is in order: only the announced count tells.
        ("lost tail", ["daq", "truth", "events/plant"],
         ["stream '{}' is incomplete", "3 messages", "2 with"]),
        ("lost tail", ["balance"], ["stream '{}' is incomplete", "1 messages", "0 with"]),
        ("malformed", ["truth"],
         ["malformed message on stream '{}' where sequence 1 was expected"]),
        ("no number", ["hello", "balance", "events/plant", "end/plant"],
         ["a message without a number came on stream '{}', 0 was expected"]),
        ("a second", ["hello", "balance", "end/plant"],
         ["a second message came on stream '{}': a plant sends one a run"]),
    ],
)  # fmt: skip
def test_messages_that_do_not_follow_each_other(fault, streams, words):
    for stream in streams:
        refused(spoilt(stream, fault), *(word.format(stream) for word in words))


def test_a_stream_without_announced_count():
    sent = plant_says()
    end = RunEnd.FromString(sent[-1].payload)
    del end.count[next(i for i, c in enumerate(end.count) if c.stream == "truth")]
    sent[-1] = replace(sent[-1], payload=end.SerializeToString())
    refused(sent, "stream 'truth' is incomplete: 0 messages with 0 samples were announced, 3 with")


def test_plant_and_controller_hear_each_other_and_no_truth():
    """What a card and an actuator would tell them, who else is at work, and nothing more."""
    assert set(SUBSCRIPTIONS[PLANT]) == {"force", "end/controller"}
    assert set(SUBSCRIPTIONS[CONTROLLER]) == {"scene", "hello", "daq", "end/plant"}


def test_a_role_ends_once():
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    publisher.end()
    publisher.end("too late")
    assert [RunEnd.FromString(e.payload).fault for e in tape.sent] == [""]


def test_counts_may_be_announced_in_any_order():
    """Whoever brings a plant names its streams as it likes, also first those not heard here."""
    sent = [e for e in plant_says() if e.stream in SUBSCRIPTIONS[CONTROLLER]]
    end = RunEnd.FromString(sent[-1].payload)
    counts = sorted(end.count, key=lambda one: one.stream in SUBSCRIPTIONS[CONTROLLER])
    assert counts[0].stream not in SUBSCRIPTIONS[CONTROLLER]
    checker = SequenceChecker(role=CONTROLLER)
    for envelope in sent:
        checker.accept(envelope)
    checker.reconcile(RunEnd(role=PLANT, count=counts))
    next(one for one in counts if one.stream == "daq").messages += 1
    with pytest.raises(StreamFault, match="stream 'daq' is incomplete"):
        checker.reconcile(RunEnd(role=PLANT, count=counts))


# A message in its place that says what cannot be.


@pytest.mark.parametrize(("value", "number"), [(math.nan, 0), (-math.inf, 2)])
def test_truth_that_is_no_number(value, number):
    sent = plant_says()
    place = places(sent, "truth")[number]
    block = codec.decode(TruthBlock, sent[place].payload)
    rows = np.array([0.0, 0.0, value, 0.0])
    sent[place] = replace(sent[place], payload=codec.encode(block.header, xi_m=rows))
    step = 4 * number + 2
    refused(sent, f"stream 'truth' sequence {number} holds xi_m = {value:g} at step {step}")


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_publisher_sends_only_numbers(value):
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    with pytest.raises(StreamFault, match=r"'truth' sequence 0 holds xi_m = .* at step 1;"):
        publisher.send("truth", TruthBlock(step_ns=1000), {"xi_m": np.array([0.0, value])})
    with pytest.raises(StreamFault, match="'balance' sequence 0 holds kinetic_j"):
        publisher.send("balance", EnergyBalance(kinetic_j=value))
    assert not tape.sent
    assert {c.messages for c in publisher.counters.values()} == {0}


def test_what_has_no_limit_may_be_infinite():
    """A promise that no sample breaks; an error of which there is no estimate."""
    publisher = Publisher(Tape(CONTROLLER), RUN)
    publisher.send("force", ForceBlock(step_ns=1000, trigger_level=-math.inf), {})
    with pytest.raises(StreamFault, match="trigger_level = inf"):
        publisher.send("force", ForceBlock(step_ns=1000, trigger_level=math.inf), {})
    Publisher(Tape(PLANT), RUN).send("balance", EnergyBalance(expected_error=math.inf))


def event_at(seconds: int, nanos: int) -> Event:
    message = Event(message="an event")
    message.timestamp.seconds, message.timestamp.nanos = seconds, nanos
    return message


@pytest.mark.parametrize(("seconds", "nanos"), [(-1, 0), (0, -1), (2**62, 0), (0, 10**9)])
def test_an_event_at_no_time_of_a_run(seconds, nanos):
    sent = plant_says()
    place = places(sent, "events/plant")[1]
    event = event_at(seconds, nanos).SerializeToString()
    sent[place] = replace(sent[place], payload=event)
    refused(sent, f"stream 'events/plant' sequence 1 has an event at {seconds} s and {nanos} ns")


@pytest.mark.parametrize(
    ("stream", "change", "words"),
    [
        ("balance", {"modal_j": math.nan}, "stream 'balance' sequence 0 holds modal_j = nan"),
        ("hello", {"steps": 0}, "announced a run of 0 steps of 1000 ns"),
        ("hello", {"steps": 2**63}, f"announced a run of {2**63} steps of 1000 ns"),
        ("hello", {"scene_toml": ""}, "the plant announced a run without a scene"),
        ("hello", {"run_id": 0}, "stream 'hello' sequence 0 belongs to run 0"),
        (
            "end/plant",
            {"role": "controller"},
            "stream 'end/plant' carries the end of 'controller', not of the plant",
        ),
    ],
)
def test_a_field_that_cannot_be(stream, change, words):
    sent = plant_says()
    [place] = places(sent, stream)
    sent[place] = changed(sent[place], **change)
    refused(sent, words)
