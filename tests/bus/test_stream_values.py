"""The checker: a message in its place that says what cannot be is named, with its number."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import EnergyBalance, Event, ForceBlock, TruthBlock
from hertzloop.bus.port import Publisher
from hertzloop.bus.streams import CONTROLLER, PLANT, StreamFault
from tests.bus.checking import refused
from tests.bus.tapes import RUN, Tape, changed, places, plant_says


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
    publisher.send("force", ForceBlock(step_ns=1000, promise_level=-math.inf), {})
    with pytest.raises(StreamFault, match="promise_level = inf"):
        publisher.send("force", ForceBlock(step_ns=1000, promise_level=math.inf), {})
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


def test_an_event_after_the_runs_end():
    """12 steps of 1 us; also when the event comes before the run is announced."""
    sent = plant_says()
    place = places(sent, "events/plant")[2]
    late = replace(sent[place], payload=event_at(0, 12_001).SerializeToString())
    refused([*sent[:place], late], "an event came for 12001 ns, the run ends at 12000 ns")
    refused([replace(late, sequence=0), sent[0]], "an event came for 12001 ns, the run ends at")


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
