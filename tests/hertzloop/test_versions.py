"""A wire peer and a recording of another version: taken, or refused with both versions named."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from hertzloop import __version__
from hertzloop import api as interface
from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import ControllerReport, Hello
from hertzloop.bus.sequence_checker import other_version
from hertzloop.bus.streams import STREAMS, Envelope, StreamFault
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.bus.tapes import plant_says
from tests.hertzloop.exchange import exchange
from tests.hertzloop.short_runs import scene
from tests.hertzloop.test_cli import call, said
from tests.recordings.rewriting import messages, record

OTHER = json.dumps({"hertzloop": "0.7.3", "numpy": "2.4"})
BOTH = f"hertzloop 0.7.3, this is {__version__}"
# As a later version may have it: a key that is not known here.
LATER = "[controller]\nforesight = 3\n"


def hellos(change: Callable[[Hello], None]) -> Callable[[Envelope], Iterable[Envelope]]:
    """On the plant's link: its hello as another version sends it."""

    def alter(envelope: Envelope) -> Iterable[Envelope]:
        if envelope.stream != "hello":
            return (envelope,)
        hello = codec.decode(STREAMS["hello"].message, envelope.payload).header
        hello.versions = OTHER
        change(hello)
        return (Envelope("hello", hello.SerializeToString(), envelope.sequence),)

    return alter


def later(hello: Hello) -> None:
    hello.scene_toml = hello.scene_toml.replace("[controller]\n", LATER)


def test_a_plant_of_another_version_is_answered() -> None:
    links = exchange(scene(), 1, forge=hellos(lambda hello: None))
    assert links.fault == ""
    assert links.heard.samples() == exchange(scene(), 1).heard.samples()


def test_a_plant_of_another_version_is_refused_with_both_named() -> None:
    with pytest.raises(StreamFault, match="the plant is " + BOTH):
        exchange(scene(), 1, forge=hellos(later))


def test_a_hello_that_is_meant_otherwise_names_both() -> None:
    def again(hello: Hello) -> None:
        hello.steps += 1

    with pytest.raises(StreamFault, match=r"its scene has 2500 of 1000 ns \(the plant is " + BOTH):
        exchange(scene(), 1, forge=hellos(again))


def end_of_controller(
    change: Callable[[ControllerReport], None],
) -> Callable[[Envelope], Iterable[Envelope]]:
    """The controller's end as another version sends it."""

    def alter(envelope: Envelope) -> Iterable[Envelope]:
        if envelope.stream != "end/controller":
            return (envelope,)
        end = codec.decode(STREAMS["end/controller"].message, envelope.payload).header
        end.report.versions = OTHER
        change(end.report)
        return (Envelope("end/controller", end.SerializeToString(), envelope.sequence),)

    return alter


def test_a_controller_of_another_version_is_taken() -> None:
    links = exchange(scene(), 1, alter=end_of_controller(lambda ran: None))
    assert links.recorder_fault == ""
    assert links.heard.samples() == exchange(scene(), 1).heard.samples()


def test_a_controller_of_another_version_is_refused_with_both_named() -> None:
    """By the plant; its recording says it, too."""

    def otherwise(ran: ControllerReport) -> None:
        ran.scene_toml = ran.scene_toml.replace("[controller]\n", LATER)

    words = r"used another scene: .*foresight.* \(the controller is " + BOTH
    with pytest.raises(StreamFault, match=words):
        exchange(scene(), 1, alter=end_of_controller(otherwise))


def test_a_controller_says_which_version_it_is() -> None:
    [ran] = [end.report for end in exchange(scene(), 1).ends if end.role == "controller"]
    assert json.loads(ran.versions)["hertzloop"] == __version__


def test_a_recorder_names_both(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap")
    said = plant_says()
    [first] = hellos(lambda hello: None)(said[0])
    recorder.handle(first)
    recorder.handle(said[1])
    with pytest.raises(StreamFault, match=r"repeat on stream .*\(the plant is " + BOTH):
        recorder.handle(said[1])


@pytest.fixture
def later_recording(tmp_path: Path) -> Path:
    """A recording as a later version may have made it."""
    whole, path = record(tmp_path / "whole.mcap"), tmp_path / "later.mcap"
    source = read(whole)
    text = source.scene_toml.replace("[controller]\n", LATER)
    writer = RecordingWriter(path)
    writer.scene(text, {**source.metadata, "versions": OTHER})
    for item in messages(whole):
        if item.stream == "hello":
            item.header.scene_toml, item.header.versions = text, OTHER
        elif item.stream == "end/controller":
            item.header.report.scene_toml = text
        payload = codec.encode(item.header, **item.arrays)
        writer.write(item.stream, payload, item.number, item.time_ns)
    writer.finish(source.result)
    return path


def test_a_recording_of_a_later_version(later_recording: Path, tmp_path: Path) -> None:
    """Its samples are there; what needs its scene says why not."""
    kept = read(later_recording)
    assert kept.problems == []
    assert kept.truth.arrays["xi_m"].tobytes() == (
        read(tmp_path / "whole.mcap").truth.arrays["xi_m"].tobytes()
    )
    with pytest.raises(RecordingError, match="foresight.*it was recorded by " + BOTH):
        interface.read(later_recording)
    out = str(tmp_path / "new.mcap")
    for words, code in (
        (["inspect", str(later_recording)], 1),
        (["replay", str(later_recording), "--save", str(tmp_path / "a.rrd")], 1),
        (["run", "--repeat", str(later_recording), "--out", out], 2),
    ):
        done = call(*words)
        assert done.exit_code == code, done.output
        assert "it was recorded by " + BOTH in said(done), words
        assert "foresight" in said(done)
    assert call("compare", str(later_recording), str(tmp_path / "whole.mcap")).exit_code == 0


@pytest.mark.parametrize(
    "versions",
    ["", "{", "[]", "7", '{"numpy": "2"}', '{"hertzloop": 3}', "[" * 9000,
     json.dumps({"hertzloop": __version__})],
)  # fmt: skip
def test_versions_that_say_nothing_else(versions: str) -> None:
    assert other_version(versions, "the plant is") == ""


def test_a_long_version_is_cut() -> None:
    said = other_version(json.dumps({"hertzloop": "1\n" + "9" * 500}), "the plant is")
    assert said == f" (the plant is hertzloop 1{'9' * 19}, this is {__version__})"
