"""A recording is what the bus carried, readable by others, and never silently incomplete."""

import json
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import hertzloop.recordings.writer
from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.bus.streams import STREAMS
from hertzloop.recordings import writer
from hertzloop.recordings.file_format import FORMAT_KEY, FORMAT_VERSION
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import SAMPLED, Recording
from hertzloop.recordings.repair import repair
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import parse
from tests.commands import refused
from tests.recordings.rewriting import messages, record, rewrite, scene

STEPS, STEP_NS = 2500, 1000
SETTINGS = ["run.seed=77", "sensors.every_steps=2"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return record(tmp_path_factory.mktemp("whole") / "whole.mcap", *SETTINGS)


@pytest.fixture(scope="module")
def decoded(whole):
    """(schema, channel, message, decoded message) by topic, as MCAP's own reader gives them."""
    topics: dict[str, list[Any]] = {}
    with whole.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for item in reader.iter_decoded_messages():
            topics.setdefault(item[1].topic, []).append(item)
    return topics


class TestByTheMcapLibrary:
    """The file read with MCAP's own tools, which know nothing of hertzloop."""

    def test_topics_and_types(self, decoded):
        types = {topic: {item[0].name for item in items} for topic, items in decoded.items()}
        assert types == {
            "/hello": {"hertzloop.Hello"},
            "/law": {"hertzloop.LawText"},
            "/daq": {"hertzloop.DaqBlock"},
            "/force": {"hertzloop.ForceBlock"},
            "/truth": {"hertzloop.TruthBlock"},
            "/events": {"foxglove.Log"},
            "/balance": {"hertzloop.EnergyBalance"},
            "/end": {"hertzloop.RunEnd"},
        }
        encodings = {i[1].message_encoding for items in decoded.values() for i in items}
        assert encodings == {"protobuf"}

    def test_times_are_simulated_nanoseconds(self, decoded):
        for topic, items in decoded.items():
            for _, _, message, content in items:
                assert message.publish_time == message.log_time
                if topic in ("/daq", "/force", "/truth"):
                    expected = content.first_step * STEP_NS
                elif topic == "/events":
                    expected = content.timestamp.ToNanoseconds()
                else:
                    expected = 0 if topic in ("/hello", "/law") else STEPS * STEP_NS
                assert message.log_time == expected

    def test_the_embedded_schemas_have_every_field(self, decoded):
        ours = {stream.topic: stream.message.DESCRIPTOR for stream in STREAMS.values()}
        for topic, items in decoded.items():
            there = items[0][3].DESCRIPTOR.fields_by_number
            for number, field in ours[topic].fields_by_number.items():
                assert there[number].name == field.name, topic
        facts = {
            i[3].DESCRIPTOR.fields_by_name["kind"].enum_type.values_by_number[i[3].kind].name
            for i in decoded["/events"]
        }
        assert facts == {"CONTACT_BEGAN", "CONTACT_ENDED", "LAW_MODE"}
        assert any(i[3].HasField("delay_ns") for i in decoded["/events"])

    def test_scene_and_metadata(self, whole):
        with whole.open("rb") as file:
            reader = make_reader(file)
            attachments = {a.name: a for a in reader.iter_attachments()}
            metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        assert set(attachments) == {"scene.toml", "law"}
        # No clock of the day: two runs of a scene have the same bytes.
        assert {(a.log_time, a.create_time) for a in attachments.values()} == {(0, 0)}
        assert parse(attachments["scene.toml"].data.decode()) == scene(*SETTINGS)
        assert attachments["law"].data.decode() == loaded_law(scene(*SETTINGS)).source
        run = metadata["run"]
        assert run[FORMAT_KEY] == FORMAT_VERSION
        assert (run["seed"], run["steps"], run["step_ns"]) == ("77", "2500", "1000")
        assert json.loads(run["versions"])["numpy"] == np.__version__
        assert {"hertzloop", "numba", "mcap", "eclipse-zenoh"} <= set(json.loads(run["versions"]))
        assert metadata["result"]["complete"] == "yes"
        assert metadata["result"]["fault"] == ""

    def test_chunks_are_compressed_and_have_checksums(self, whole):
        with whole.open("rb") as file:
            found = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
        chunks = [r for r in found if isinstance(r, Chunk)]
        assert chunks
        assert {c.compression for c in chunks} == {"zstd"}
        assert all(c.uncompressed_crc for c in chunks)
        # What is recorded comes first: it survives whatever happens later.
        kinds = [type(r) for r in found]
        assert kinds.index(Attachment) < kinds.index(Chunk)


def test_our_reader_agrees(whole, decoded):
    kept = read(whole)
    assert kept.problems == []
    for name in ("daq", "force", "truth"):
        stream = getattr(kept, name)
        assert stream.messages == len(decoded[f"/{name}"])
        for label, values in stream.arrays.items():
            joined = np.concatenate([getattr(i[3], label) for i in decoded[f"/{name}"]])
            assert values.tobytes() == joined.tobytes(), label
    names = "xi_m", "xi_s_m", "xi_p_m", "v_p_m_s", "f_c_n", "f_a_n", "f_c1_n"
    assert set(kept.truth.arrays) == set(names)
    assert kept.daq.time_ns.tolist() == list(range(0, STEPS * STEP_NS, 2 * STEP_NS))
    assert np.array_equal(kept.daq.values, kept.truth.arrays["xi_m"][::2])
    assert kept.balance.contact_steps > 0
    # MCAP's reader goes by time, ours by the file: as they were heard.
    events = {(i[2].log_time, i[3].name, i[3].message) for i in decoded["/events"]}
    assert {(e.time_ns, e.name, e.message) for e in kept.events} == events
    assert len(kept.events) == len(decoded["/events"])


@pytest.mark.parametrize(
    ("stream", "place"),
    [
        *product(("daq", "truth"), (1, -1)),
        ("hello", -1),
        ("balance", -1),
        ("events/plant", -1),
        ("events/controller", -1),
    ],
)
def test_a_missing_message_is_named(whole, tmp_path, stream, place):
    """In a file that is whole otherwise: nothing but numbers and counts can tell."""
    all_of = [m for m in messages(whole) if m.stream == stream]
    lost = all_of[place].number
    kept = read(
        rewrite(whole, tmp_path / "b.mcap", lambda m: (m.stream, m.number) != (stream, lost))
    )
    told = " ".join(kept.problems)
    assert f"stream '{stream}'" in told
    if stream in SAMPLED:
        assert getattr(kept, stream).messages == lost  # what follows is not read
    gap = f"gap on stream '{stream}': sequence {lost + 1} came, {lost} was expected"
    assert (gap in told) == (place == 1)


def test_codes_become_values(tmp_path):
    kept = read(record(tmp_path / "run.mcap", "sensors.bits=16"))
    step = kept.daq.scale
    inside = kept.daq.arrays["saturated"] == 0
    error = (kept.daq.values - kept.truth.arrays["xi_m"])[inside]
    # Half a step of the converter, and the rounding of numbers of up to 2^16 steps.
    assert np.max(np.abs(error)) <= step * (0.5 + 2.0**-34)
    assert np.count_nonzero(inside) > 30  # the contact takes so long; most of the fall is out


class TestWriter:
    def test_an_existing_file_is_kept(self, tmp_path):
        path = tmp_path / "kept.mcap"
        path.write_bytes(b"precious")
        with pytest.raises(RecordingError, match=r"kept\.mcap exists. Choose another name"):
            RecordingWriter(path)
        assert path.read_bytes() == b"precious"
        writer = RecordingWriter(path, overwrite=True)
        writer.scene("# scene", {})
        writer.finish({})
        assert path.read_bytes().startswith(b"\x89MCAP")

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
    @pytest.mark.parametrize("scene_bytes", [10, 1_000_000])
    def test_a_full_disk_gives_a_sentence(self, scene_bytes):
        writer = RecordingWriter(Path("/dev/full"), overwrite=True)
        with pytest.raises(RecordingError, match="cannot write the recording /dev/full: No space"):
            writer.scene("#" * scene_bytes, {"seed": "1"})
        with pytest.raises(RecordingError, match="cannot write the recording /dev/full: No space"):
            writer.finish({"fault": "#" * scene_bytes})

    def test_a_killed_recorder_loses_the_last_50_ms_at_most(self, tmp_path, monkeypatch):
        clock = [0.0]
        monkeypatch.setattr(
            hertzloop.recordings.writer, "time", SimpleNamespace(monotonic=lambda: clock[0])
        )
        path = tmp_path / "run.mcap"
        writer = RecordingWriter(path)
        writer.scene("# scene", {"steps": "10"})
        for i in range(3):
            clock[0] += 0.051
            header = TruthBlock(run_id=1, sequence=i, first_step=i, step_ns=1000, xi_m=[0.5])
            writer.write("truth", header.SerializeToString(), i, 1000 * i)
            assert read(path).truth.samples == i + 1
        writer.finish({})


class TestFromElsewhere:
    @pytest.mark.parametrize("topic", ["/imu", "/truth", "/end"])
    def test_an_mcap_without_our_streams(self, tmp_path, topic):
        """Topics may even have our names; what is in them is not ours."""
        path = tmp_path / "drone.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("Imu", "jsonschema", b"{}")
            channel = writer.register_channel(topic, "json", schema)
            for i in range(3):
                writer.add_message(channel, i, b'{"a": 1}', i, i)
            writer.finish()
        with pytest.raises(RecordingError, match=r"drone\.mcap .*not a recording of hertzloop"):
            read(path)


def test_a_recording_without_a_controller_says_so(tmp_path):
    """Only the scene came: readable, with everything that is missing named."""
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path)
    writer.scene("# scene", {"steps": "10"})
    writer.finish({})
    kept: Recording = read(path)
    with path.open("rb") as file:
        assert not any(isinstance(r, Channel) for r in StreamReader(file).records)
    assert kept.daq.samples == kept.force.samples == kept.truth.samples == 0
    assert len(kept.daq.values) == 0
    assert kept.problems == [
        "the plant announced no end: counts cannot be reconciled",
        "the controller announced no end: counts cannot be reconciled",
        "readable to step 0 of 10 announced",
    ]


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("FORMAT_VERSION", "999", "has format version '999'"),
        ("FORMAT_VERSION", "7\n" + 99 * "7", f"has format version '{20 * '7'}'"),
        ("FORMAT_KEY", "format", "has no format version"),
    ],
)
def test_another_format_version_is_refused(tmp_path, monkeypatch, name, value, found):
    monkeypatch.setattr(writer, name, value)
    monkeypatch.setattr(writer, "PROFILE", "hertzloop")
    path = record(tmp_path / "a.mcap")
    sentence = (
        f"{path} {found}, this hertzloop reads format version {FORMAT_VERSION}. Record the run "
        "again, or read the file with the version of hertzloop that wrote it."
    )
    with pytest.raises(RecordingError) as not_read:
        read(path)
    assert str(not_read.value) == sentence
    with pytest.raises(RecordingError) as not_repaired:
        repair(path, tmp_path / "b.mcap")
    assert str(not_repaired.value) == f"nothing to repair: {sentence}"
    for words in (["inspect"], ["replay", "--save", str(tmp_path / "a.rrd")]):
        refused(found, *words, path)


def test_a_damaged_format_version_does_not_make_a_recording_unreadable(tmp_path):
    path = record(tmp_path / "a.mcap")
    content = bytearray(path.read_bytes())
    content[content.index(FORMAT_KEY.encode())] ^= 0x40
    path.write_bytes(content)
    kept = read(path)
    assert "the file's description has no format version, unlike its header" in kept.problems
    assert kept.truth.samples == 2500
