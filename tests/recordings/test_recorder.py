"""The recorder: what it hears is checked, written down and counted."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from hertzloop.bus.messages_pb2 import Hello, RunEnd
from hertzloop.bus.streams import LAST_NS, Envelope, StreamFault
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.bus.tapes import SCENE, changed, controller_says, places, plant_says


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


def both() -> list[Envelope]:
    """Plant and controller taking turns, as a recorder hears them."""
    plant, controller = plant_says(), controller_says()
    heard = []
    for i in range(max(len(plant), len(controller))):
        heard += plant[i : i + 1] + controller[i : i + 1]
    return heard


def hear(path: Path, heard: Sequence[Envelope]) -> Recorder:
    """Record to the end, or to the first fault, as a recorder's process does."""
    recorder = Recorder(path)
    fault = ""
    try:
        for envelope in heard:
            recorder.handle(envelope)
        recorder.reconcile()
    except StreamFault as error:
        fault = str(error)
        raise
    finally:
        recorder.close(fault)
    return recorder


def test_a_whole_run(path):
    recorder = hear(path, both())
    assert recorder.done
    assert not recorder.faults
    counts = {name: (c.messages, c.samples) for name, c in recorder.counters.items()}
    assert counts["force"] == (3, 12)
    assert counts["truth"] == (3, 12)
    kept = read(path)
    assert kept.problems == []
    assert (kept.daq.samples, kept.force.samples, kept.truth.samples) == (12, 12, 12)
    assert len(kept.events) == 6
    assert kept.result["complete"] == "yes"
    assert kept.result["truth"] == "3 12"
    assert kept.metadata["run_id"] == "abc"


def test_done_only_when_both_roles_have_ended(path):
    recorder = Recorder(path)
    done = []
    for envelope in [*plant_says(), *controller_says()]:
        recorder.handle(envelope)
        done.append(recorder.done)
    recorder.close()
    assert done == [False] * (len(done) - 1) + [True]


@pytest.mark.parametrize("role", ["plant", "controller"])
def test_a_role_that_never_ended(path, role):
    heard = [e for e in both() if e.stream != f"end/{role}"]
    with pytest.raises(StreamFault, match=f"the {role} never announced its end"):
        hear(path, heard)
    assert f"the {role} announced no end: counts cannot be reconciled" in read(path).problems


def check_fault(path: Path, heard: Sequence[Envelope], pattern: str) -> None:
    """The fault is raised, kept in the file, and what came before it is readable."""
    with pytest.raises(StreamFault, match=pattern) as caught:
        hear(path, heard)
    kept = read(path)
    assert kept.result["complete"] == "no"
    assert kept.result["fault"] == str(caught.value)
    assert f"the run failed: {caught.value}" in kept.problems
    assert kept.truth.samples > 0


@pytest.mark.parametrize(
    ("stream", "fault", "pattern"),
    [
        ("daq", "gap", "gap on stream 'daq': sequence 2 came, 1 was expected"),
        ("balance", "lost tail", "stream 'balance' is incomplete"),
        ("end/plant", "malformed", "malformed message on stream 'end/plant' where sequence 0"),
    ],
)
def test_a_fault_of_a_stream(path, stream, fault, pattern):
    heard = both()
    at = places(heard, stream)
    if fault == "gap":
        del heard[at[1]]
    elif fault == "lost tail":
        del heard[at[-1]]
    else:
        heard[at[-1]] = replace(heard[at[-1]], payload=heard[at[-1]].payload[:-1])
    check_fault(path, heard, pattern)


def test_a_fault_that_a_role_announces(path):
    """The recording is whole, but its run failed; each fault is told once."""
    heard = both()
    for stream in ("end/plant", "end/controller"):
        place = places(heard, stream)[0]
        heard[place] = changed(heard[place], fault="the plate broke")
    recorder = hear(path, heard)
    assert set(recorder.faults) == {"the plate broke"}
    kept = read(path)
    assert kept.result["fault"] == "the plate broke"
    assert kept.problems == ["the run failed: the plate broke"]


def test_a_lost_tail_does_not_hide_why_a_run_failed(path):
    """Who is cut off in the middle of a message cannot count what of it arrived."""
    heard = both()
    end = places(heard, "end/plant")[0]
    heard[end] = changed(heard[end], fault="the controller took no message")
    del heard[places(heard, "balance")[0]]
    first, second = hear(path, heard).faults
    assert first == "the controller took no message"
    assert "stream 'balance' is incomplete" in second
    assert read(path).result["fault"] == f"{first}; {second}"


def test_an_end_without_a_beginning(path):
    """A recorder that missed the hello: a fault of the stream, not of the recorder."""
    recorder = Recorder(path)
    try:
        recorder.handle(controller_says(0)[-1])
        with pytest.raises(StreamFault, match="the plant never announced its end"):
            recorder.reconcile()
    finally:
        recorder.close("no plant")
    with pytest.raises(RecordingError, match="holds no scene"):
        read(path)


def test_a_second_hello(path):
    """The recording keeps the scene of the first, and says what came."""
    heard = both()
    second = changed(heard[0], scene_toml="# another")
    heard.insert(places(heard, "truth")[1], replace(second, sequence=1))
    check_fault(path, heard, "a second message came on stream 'hello'")
    assert read(path).scene_toml == SCENE


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        (SCENE.replace("0.8", "-5.0"), "another scene: 'kappa = -5.0' where .* 'kappa = 0.8'"),
        (
            SCENE + "\nmore = " + 200 * "1",
            "scene: 'more = " + 93 * "1" + "' where the plant announced 'nothing'",
        ),
        ("", "the final message of the controller names no scene"),
    ],
)
def test_a_controller_that_worked_by_another_scene(path, said, sentence):
    heard = both()
    place = places(heard, "end/controller")[0]
    end = RunEnd.FromString(heard[place].payload)
    end.report.scene_toml = said
    heard[place] = replace(heard[place], payload=end.SerializeToString())
    check_fault(path, heard, sentence)


def test_a_controller_that_failed_need_not_say_by_which_scene(path):
    heard = both()
    place = places(heard, "end/controller")[0]
    end = RunEnd.FromString(heard[place].payload)
    end.ClearField("report")
    end.fault = "out of force"
    heard[place] = replace(heard[place], payload=end.SerializeToString())
    assert hear(path, heard).faults == ["out of force"]


@pytest.mark.parametrize("time_ns", [-1, 2**64])
def test_a_time_that_no_recording_holds(path, time_ns):
    """What the recorder's checks let through would be told, too, and leave the file whole."""
    writer = RecordingWriter(path)
    writer.scene(SCENE, {})
    hello = Hello(scene_toml=SCENE).SerializeToString()
    with pytest.raises(RecordingError, match=f"stream 'hello' sequence 0 is at {time_ns} ns"):
        writer.write("hello", hello, 0, time_ns)
    writer.write("hello", hello, 0, LAST_NS)
    writer.finish({})
    assert read(path).scene_toml == SCENE
