"""The checker: anything that does not continue its stream is named, with its number."""

from dataclasses import replace

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import ForceBlock, RunEnd, TruthBlock
from hertzloop.bus.port import Publisher
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import (
    CONTROLLER,
    PLANT,
    SUBSCRIPTIONS,
    Envelope,
    StreamFault,
)
from tests.bus.checking import feed, refused
from tests.bus.tapes import RUN, Tape, changed, places, plant_says


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
        ("truth", 2, {"run_id": 0xDEF}, ["belongs to run def", "not to abc"]),
        ("daq", 1, {"first_step": 3}, ["starts at step 3", "expected 4"]),
        ("truth", 1, {"first_step": 0}, ["starts at step 0", "expected 4"]),
        ("daq", 0, {"step_ns": 500}, ["500 ns", "announced were 1000 ns"]),
        # Samples of one stream have one scale: a reader takes it from the first block.
        ("daq", 2, {"every_steps": 2}, ["every_steps"]),
        ("daq", 2, {"scale": 0.25}, ["scale"]),
        ("daq", 2, {"offset": 1.0}, ["offset"]),
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
    elif fault == "lost first":
        del sent[at[0]]
    elif fault == "lost tail":
        del sent[at[-1]]
    elif fault == "repeat":
        sent.insert(at[-1], sent[at[-1]])
    elif fault == "swapped":
        sent[at[0]], sent[at[1]] = sent[at[1]], sent[at[0]]
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
        ("lost first", ["daq", "events/plant"],
         ["gap on stream '{}'", "sequence 1 came", "0 was expected"]),
        ("repeat", ["daq", "truth", "events/plant"],
         ["repeat on stream '{}'", "sequence 2 came", "3 was expected"]),
        ("repeat", ["hello", "balance"],
         ["repeat on stream '{}'", "sequence 0 came", "1 was expected"]),
        ("swapped", ["daq", "truth", "events/plant"], ["gap on stream '{}'", "sequence 1 came"]),
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


def test_the_length_of_a_step_may_be_known_before():
    force = ForceBlock(run_id=RUN, step_ns=2000)
    with pytest.raises(StreamFault, match=r"'force' sequence 0 has steps of 2000 ns.* 1000 ns"):
        SequenceChecker(RUN, 1000).accept(
            Envelope("force", codec.encode(force, force_n=np.zeros(2)))
        )


@pytest.mark.parametrize(("field", "by"), [("messages", 1), ("messages", -1), ("samples", 1)])
def test_a_wrong_announced_count(field, by):
    sent = plant_says()
    end = RunEnd.FromString(sent[-1].payload)
    truth = next(c for c in end.count if c.stream == "truth")
    setattr(truth, field, getattr(truth, field) + by)
    sent[-1] = replace(sent[-1], payload=end.SerializeToString())
    refused(sent, "stream 'truth'", f"{truth.messages} messages with {truth.samples} samples")


def test_a_stream_without_announced_count():
    sent = plant_says()
    end = RunEnd.FromString(sent[-1].payload)
    del end.count[next(i for i, c in enumerate(end.count) if c.stream == "truth")]
    sent[-1] = replace(sent[-1], payload=end.SerializeToString())
    refused(sent, "plant announced no count for stream 'truth'")


def test_plant_and_controller_hear_each_other_and_no_truth():
    """What a card and an actuator would tell them, who else is at work, and nothing more."""
    assert set(SUBSCRIPTIONS[PLANT]) == {"force", "end/controller"}
    assert set(SUBSCRIPTIONS[CONTROLLER]) == {"scene", "hello", "daq", "end/plant"}


def test_an_end_says_why():
    tape = Tape(PLANT)
    Publisher(tape, RUN).end("the plate broke")
    end = RunEnd.FromString(tape.sent[-1].payload)
    assert (end.role, end.fault) == (PLANT, "the plate broke")
    assert {c.messages for c in end.count} == {0}


def test_an_absent_array_does_not_count():
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    arrays = {"xi_m": np.zeros(5), "xi_a_m": np.empty(0)}
    publisher.send("truth", TruthBlock(step_ns=1000), arrays)
    publisher.end()
    checker = feed(tape.sent)
    assert checker.counters["truth"].samples == publisher.counters["truth"].samples == 5


def test_a_role_ends_once():
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    publisher.end()
    publisher.end("too late")
    assert [RunEnd.FromString(e.payload).fault for e in tape.sent] == [""]


def test_a_role_reconciles_all_that_it_hears_and_no_more():
    """The controller hears the hello and the samples, not the truth."""
    sent = [e for e in plant_says() if e.stream in SUBSCRIPTIONS[CONTROLLER]]
    checker = SequenceChecker(role=CONTROLLER)
    for envelope in sent:
        block = checker.accept(envelope)
    checker.reconcile(block.header)
    for stream in ("hello", "daq"):
        end = RunEnd.FromString(sent[-1].payload)
        next(c for c in end.count if c.stream == stream).messages += 1
        with pytest.raises(StreamFault, match=f"stream '{stream}' is incomplete"):
            checker.reconcile(end)


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
