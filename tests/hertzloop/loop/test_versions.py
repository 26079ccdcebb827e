"""A wire peer and a recording of another version: taken, or refused with both versions named."""

import json
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from hertzloop import __version__
from hertzloop import api as interface
from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import ControllerReport, Hello
from hertzloop.bus.sequence_checker import other_version
from hertzloop.bus.streams import STREAMS, Envelope, StreamFault
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from tests.commands import refused, succeed
from tests.hertzloop.exchange import exchange
from tests.hertzloop.short_runs import scene
from tests.recordings.rewriting import messages, record, write

OTHER = json.dumps({"hertzloop": "0.7.3", "numpy": "2.4"})
BOTH = f"hertzloop 0.7.3, this is {__version__}"
# As a later version may have it: a key that is not known here.
LATER = "[controller]\nforesight = 3\n"


def sent(stream: str, change: Callable[[Any], object] = bool) -> dict[str, Any]:
    """Arguments of `exchange`: hello or end as another version sends it, after a change."""

    def alter(envelope: Envelope) -> Iterable[Envelope]:
        if envelope.stream != stream:
            return (envelope,)
        header = codec.decode(STREAMS[stream].message, envelope.payload).header
        said = header if stream == "hello" else header.report
        said.versions = OTHER
        change(said)
        return (Envelope(stream, header.SerializeToString(), envelope.sequence),)

    return {"forge" if stream == "hello" else "alter": alter}


def later(said: Hello | ControllerReport) -> None:
    said.scene_toml = said.scene_toml.replace("[controller]\n", LATER)


def one_step_more(hello: Hello) -> None:
    hello.steps += 1


@pytest.mark.parametrize("stream", ["hello", "end/controller"])
def test_another_version_is_taken_where_it_is_understood(stream):
    links = exchange(scene(), 1, **sent(stream))
    assert links.fault == links.recorder_fault == ""
    assert links.heard.samples() == exchange(scene(), 1).heard.samples()


@pytest.mark.parametrize(
    ("stream", "change", "words"),
    [
        ("hello", later, "the plant is "),
        ("hello", one_step_more, r"its scene has 2500 of 1000 ns \(the plant is "),
        ("end/controller", later, r"used another scene: .*foresight.* \(the controller is "),
    ],
)
def test_another_version_is_refused_with_both_named(stream, change, words):
    with pytest.raises(StreamFault, match=words + BOTH):
        exchange(scene(), 1, **sent(stream, change))


def test_a_recording_of_a_later_version(tmp_path):
    """Its samples are there; what needs its scene says why not."""
    whole, path = record(tmp_path / "whole.mcap"), tmp_path / "later.mcap"
    source, sent = read(whole), messages(whole)
    for item in sent:
        if item.stream in ("hello", "end/controller"):
            later(item.header if item.stream == "hello" else item.header.report)
        if item.stream == "hello":
            item.header.versions = OTHER
    text = source.scene_toml.replace("[controller]\n", LATER)
    write(path, whole, sent, text, versions=OTHER)

    kept = read(path)
    assert kept.problems == []
    assert kept.truth.arrays["xi_m"].tobytes() == source.truth.arrays["xi_m"].tobytes()
    with pytest.raises(RecordingError, match="foresight.*it was recorded by " + BOTH):
        interface.read(path)
    for words, code in (
        (["inspect", path], 1),
        (["replay", path, "--save", tmp_path / "a.rrd"], 1),
        (["run", "--repeat", path, "--out", tmp_path / "new.mcap"], 2),
    ):
        assert "foresight" in refused("it was recorded by " + BOTH, *words, code=code)
    succeed("compare", path, whole)


@pytest.mark.parametrize(
    ("versions", "words"),
    [
        *((text, "") for text in ("", "[]", '{"hertzloop": 3}', "[" * 9000)),
        (json.dumps({"hertzloop": __version__}), ""),
        (
            json.dumps({"hertzloop": "1\n" + "9" * 500}),
            f" (the plant is hertzloop 1{'9' * 19}, this is {__version__})",
        ),
    ],
)
def test_versions_are_checked_and_cut(versions, words):
    assert other_version(versions, "the plant is") == words
