"""The recorder: what it hears is checked, written down and counted."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.streams import Envelope, StreamFault
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError
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


def check_fault(path: Path, heard: Sequence[Envelope], pattern: str) -> None:
    """The fault is raised, kept in the file, and what came before it is readable."""
    with pytest.raises(StreamFault, match=pattern) as caught:
        hear(path, heard)
    kept = read(path)
    assert kept.result["complete"] == "no"
    assert kept.result["fault"] == str(caught.value)
    assert f"the run failed: {caught.value}" in kept.problems
    assert kept.truth.samples > 0


def test_a_fault_of_a_stream(path):
    heard = both()
    del heard[places(heard, "daq")[1]]
    check_fault(path, heard, "gap on stream 'daq': sequence 2 came, 1 was expected")


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


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        (SCENE.replace("0.8", "-5.0"), "another scene: 'kappa = -5.0' where .* 'kappa = 0.8'"),
        (
            SCENE + "\nmore = " + 200 * "1",
            "scene: 'more = " + 93 * "1" + "' where the plant announced 'nothing'",
        ),
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
