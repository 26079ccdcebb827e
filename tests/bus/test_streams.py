"""The checker: anything that does not continue its stream is named, with its number."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from google.protobuf.message import Message

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import ForceBlock, RunEnd, TruthBlock
from hertzloop.bus.port import Publisher
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import (
    CONTROLLER,
    PLANT,
    RECORDER,
    STREAMS,
    SUBSCRIPTIONS,
    Envelope,
    StreamFault,
)
from tests.bus.checking import feed, refused
from tests.bus.tapes import RUN, Tape, changed, places, plant_says


@pytest.mark.parametrize("every_steps", [1, 3])
def test_a_whole_run_passes(every_steps: int) -> None:
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


def test_a_long_run_passes() -> None:
    """Its numbers are beyond those that Python keeps one object of."""
    assert feed(plant_says(blocks=300)).counters["daq"].messages == 300


@pytest.mark.parametrize("stream", ["daq", "truth", "events/plant"])
def test_a_gap(stream: str) -> None:
    sent = plant_says()
    del sent[places(sent, stream)[1]]
    refused(sent, f"gap on stream '{stream}'", "sequence 2 came", "1 was expected")


@pytest.mark.parametrize("stream", ["daq", "truth", "events/plant"])
def test_a_lost_first_message(stream: str) -> None:
    sent = plant_says()
    del sent[places(sent, stream)[0]]
    refused(sent, f"gap on stream '{stream}'", "sequence 1 came", "0 was expected")


@pytest.mark.parametrize("stream", ["hello", "daq", "truth", "events/plant", "balance"])
def test_a_repeat(stream: str) -> None:
    sent = plant_says()
    last = places(sent, stream)[-1]
    number = len(places(sent, stream)) - 1
    sent.insert(last, sent[last])
    refused(
        sent,
        f"repeat on stream '{stream}'",
        f"sequence {number} came",
        f"{number + 1} was expected",
    )


@pytest.mark.parametrize("stream", ["daq", "truth", "events/plant"])
def test_two_messages_swapped(stream: str) -> None:
    sent = plant_says()
    one, other, _ = places(sent, stream)
    sent[one], sent[other] = sent[other], sent[one]
    refused(sent, f"gap on stream '{stream}'", "sequence 1 came")


@pytest.mark.parametrize("stream", ["daq", "truth", "end/plant"])
def test_a_message_of_another_run(stream: str) -> None:
    sent = plant_says()
    place = places(sent, stream)[-1]
    sent[place] = changed(sent[place], run_id=0xDEF)
    number = len(places(sent, stream)) - 1
    refused(sent, f"stream '{stream}' sequence {number}", "belongs to run def", "not to abc")


def test_a_message_without_run() -> None:
    sent = plant_says()
    place = places(sent, "daq")[1]
    sent[place] = changed(sent[place], run_id=0)
    refused(sent, "stream 'daq' sequence 1", "belongs to run 0")


@pytest.mark.parametrize("stream", ["daq", "truth"])
@pytest.mark.parametrize("first_step", [0, 3, 5, 8])
def test_a_block_that_does_not_join(stream: str, first_step: int) -> None:
    sent = plant_says()
    place = places(sent, stream)[1]
    sent[place] = changed(sent[place], first_step=first_step)
    refused(sent, f"stream '{stream}' sequence 1", f"starts at step {first_step}", "expected 4")


@pytest.mark.parametrize("stream", ["daq", "truth"])
@pytest.mark.parametrize(("number", "step_ns"), [(0, 500), (1, 2000), (2, 0)])
def test_a_step_of_another_length(stream: str, number: int, step_ns: int) -> None:
    sent = plant_says()
    place = places(sent, stream)[number]
    sent[place] = changed(sent[place], step_ns=step_ns)
    refused(sent, f"stream '{stream}' sequence {number}", f"{step_ns} ns", "announced were 1000 ns")


def test_the_length_of_a_step_may_be_known_before() -> None:
    force = ForceBlock(run_id=RUN, step_ns=2000)
    with pytest.raises(StreamFault, match=r"'force' sequence 0 has steps of 2000 ns.* 1000 ns"):
        SequenceChecker(RUN, 1000).accept(
            Envelope("force", codec.encode(force, force_n=np.zeros(2)))
        )


@pytest.mark.parametrize("change", [{"every_steps": 2}, {"scale": 0.25}, {"offset": 1.0}])
def test_a_channel_that_changes(change: dict[str, float]) -> None:
    """Samples of one stream have one scale: a reader takes it from the first block."""
    sent = plant_says()
    place = places(sent, "daq")[2]
    sent[place] = changed(sent[place], **change)
    refused(sent, "stream 'daq' sequence 2", next(iter(change)))


def test_a_channel_without_interval() -> None:
    sent = plant_says()
    place = places(sent, "daq")[0]
    sent[place] = changed(sent[place], every_steps=0)
    refused(sent, "stream 'daq' sequence 0", "every_steps")


def test_flags_for_another_number_of_samples() -> None:
    sent = plant_says()
    place = places(sent, "daq")[1]
    sent[place] = changed(sent[place], saturated=bytes(3))
    refused(sent, "stream 'daq' sequence 1", "3 flags for 4 samples")


@pytest.mark.parametrize("stream", ["daq", "truth", "events/plant", "balance"])
def test_a_lost_tail(stream: str) -> None:
    """All that came is in order: only the announced count tells."""
    sent = plant_says()
    came = len(places(sent, stream)) - 1
    del sent[places(sent, stream)[-1]]
    refused(sent, f"stream '{stream}' is incomplete", f"{came + 1} messages", f"{came} with")


@pytest.mark.parametrize(("field", "by"), [("messages", 1), ("messages", -1), ("samples", 1)])
def test_a_wrong_announced_count(field: str, by: int) -> None:
    sent = plant_says()
    end = RunEnd.FromString(sent[-1].payload)
    truth = next(c for c in end.count if c.stream == "truth")
    setattr(truth, field, getattr(truth, field) + by)
    sent[-1] = replace(sent[-1], payload=end.SerializeToString())
    refused(sent, "stream 'truth'", f"{truth.messages} messages with {truth.samples} samples")


def test_a_stream_without_announced_count() -> None:
    sent = plant_says()
    end = RunEnd.FromString(sent[-1].payload)
    del end.count[next(i for i, c in enumerate(end.count) if c.stream == "truth")]
    sent[-1] = replace(sent[-1], payload=end.SerializeToString())
    refused(sent, "plant announced no count for stream 'truth'")


def test_a_malformed_message() -> None:
    sent = plant_says()
    place = places(sent, "truth")[1]
    sent[place] = replace(sent[place], payload=sent[place].payload[:-1])
    refused(sent, "malformed message on stream 'truth' where sequence 1 was expected")


def test_every_stream_has_one_publisher_and_is_heard() -> None:
    assert {s.publisher for s in STREAMS.values()} == {PLANT, CONTROLLER}
    assert set(SUBSCRIPTIONS[RECORDER]) == set(STREAMS)
    for role, heard in SUBSCRIPTIONS.items():
        assert all(STREAMS[name].publisher != role for name in heard)


def test_plant_and_controller_hear_each_other_and_no_truth() -> None:
    """What a card and an actuator would tell them, who else is at work, and nothing more."""
    assert set(SUBSCRIPTIONS[PLANT]) == {"force", "end/controller"}
    assert set(SUBSCRIPTIONS[CONTROLLER]) == {"scene", "hello", "daq", "end/plant"}


def test_a_publisher_announces_all_its_streams() -> None:
    end = RunEnd.FromString(plant_says()[-1].payload)
    own = {n for n, s in STREAMS.items() if s.publisher == PLANT and not n.startswith("end/")}
    assert {c.stream for c in end.count} == own
    assert end.run_id == RUN
    assert end.role == PLANT


def test_an_end_says_why() -> None:
    tape = Tape(PLANT)
    Publisher(tape, RUN).end("the plate broke")
    end = RunEnd.FromString(tape.sent[-1].payload)
    assert (end.role, end.fault) == (PLANT, "the plate broke")
    assert {c.messages for c in end.count} == {0}


def test_an_absent_array_does_not_count() -> None:
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    arrays = {"xi_m": np.zeros(5), "xi_a_m": np.empty(0)}
    publisher.send("truth", TruthBlock(step_ns=1000), arrays)
    publisher.end()
    checker = feed(tape.sent)
    assert checker.counters["truth"].samples == publisher.counters["truth"].samples == 5


def test_a_publisher_numbers_each_stream() -> None:
    sent = plant_says()
    for stream in ("daq", "truth"):
        message: type[Message] = STREAMS[stream].message
        headers: list[Any] = [message.FromString(sent[i].payload) for i in places(sent, stream)]
        assert [h.sequence for h in headers] == [0, 1, 2]
        assert {h.run_id for h in headers} == {RUN}
    assert [sent[i].sequence for i in places(sent, "events/plant")] == [0, 1, 2]


@pytest.mark.parametrize("stream", ["hello", "balance", "events/plant", "end/plant"])
def test_a_message_without_its_number(stream: str) -> None:
    sent = plant_says()
    place = places(sent, stream)[0]
    sent[place] = replace(sent[place], sequence=None)
    refused(sent, f"a message without a number came on stream '{stream}', 0 was expected")


@pytest.mark.parametrize("stream", ["hello", "balance", "end/plant"])
def test_a_second_message_where_one_is_due(stream: str) -> None:
    """Numbered as if it continued the stream: the run would have two scenes, two balances."""
    sent = plant_says()
    place = places(sent, stream)[0]
    sent.insert(place + 1, replace(sent[place], sequence=1))
    refused(sent, f"a second message came on stream '{stream}': a plant sends one a run")


def test_a_run_without_number_is_none() -> None:
    sent = plant_says()
    sent[0] = changed(sent[0], run_id=0)
    refused(sent, "stream 'hello' sequence 0 belongs to run 0")


def test_a_role_ends_once() -> None:
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    publisher.end()
    publisher.end("too late")
    assert [RunEnd.FromString(e.payload).fault for e in tape.sent] == [""]


def test_a_role_reconciles_all_that_it_hears_and_no_more() -> None:
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


def test_counts_may_be_announced_in_any_order() -> None:
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
