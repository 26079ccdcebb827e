"""Who adds a topic of his own to a recording is told that it is passed over."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from tests.commands import succeed
from tests.recordings.rewriting import record


def with_temperatures(original: Path, path: Path, count: int, **options: bool) -> Path:
    """A copy in which another tool has put `count` messages before ours."""
    with original.open("rb") as source, path.open("wb") as target:
        reader, writer = make_reader(source), Writer(target, **options)
        writer.start()
        own = writer.register_channel("/room/temperature", "json", 0)
        for number in range(count):
            writer.add_message(own, number, b'{"celsius": 21.5}', number)
        for item in reader.iter_attachments():
            writer.add_attachment(
                item.create_time, item.log_time, item.name, item.media_type, item.data
            )
        for item in reader.iter_metadata():
            writer.add_metadata(item.name, item.metadata)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind
                )
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()
    return path


def test_messages_of_other_topics_are_counted_and_told(tmp_path):
    original = record(tmp_path / "a.mcap", compiled=True)
    path = with_temperatures(original, tmp_path / "b.mcap", 3, enable_data_crcs=True)
    found = read(path)
    assert found.others == 3
    assert not found.problems
    assert first_difference(read(original), found) is None
    assert "Ignored: 3 messages of other topics." in succeed("inspect", path, "--details")
    assert "Ignored" not in succeed("inspect", original, "--details")
    whole = tmp_path / "c.mcap"
    assert "; ignored: 3 of other topics" in succeed("repair", path, "--out", whole)
    assert read(whole).others == 0


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_of_another_writer_needs_no_checksums(tmp_path, chunked):
    """MCAP lets a writer leave them out. A file without them is not damaged; that nobody would see
    damage is said."""
    original, whole = record(tmp_path / "a.mcap", compiled=True), tmp_path / "c.mcap"
    path = with_temperatures(
        original, tmp_path / "b.mcap", 0, enable_crcs=False, use_chunking=chunked
    )
    found = read(path)
    assert not found.problems
    assert first_difference(read(original), found) is None
    assert found.unchecked == 1 + chunked  # a chunk, and all data together
    sentence = f"{found.unchecked} parts of the file have no checksum"
    assert f"Not checked: {sentence}" in succeed("inspect", path)
    assert "Not checked" not in succeed("inspect", original)
    assert f"b.mcap: {sentence}" in succeed("repair", path, "--out", whole)
    assert read(whole).unchecked == 0
    path.write_bytes(path.read_bytes()[:-60])
    assert any("damaged" in problem for problem in read(path).problems)
