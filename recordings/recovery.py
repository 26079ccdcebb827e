"""Make a whole file of a recording that was cut off or damaged."""

from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata

from bus.streams import STREAMS
from recordings.reader import Damage, records
from recordings.writer import RUN_METADATA, SCENE_ATTACHMENT, RecordingError, RecordingWriter

_STREAM_OF_TOPIC = {stream.topic: stream.name for stream in STREAMS.values()}


def recover(path: Path, whole: Path, overwrite: bool = False) -> int:
    """Copy every readable message of `path` into a new file, with index and checksums.

    The new file says that it is incomplete and why. Returns the number of messages. Raises
    RecordingError if there is nothing to recover or the new file cannot be written.
    """
    scene, metadata, fault = "", {}, "the recorder did not finish the file"
    topics: dict[int, str] = {}
    writer: RecordingWriter | None = None
    copied = 0
    try:
        for record in records(path):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Attachment) and record.name == SCENE_ATTACHMENT:
                scene = record.data.decode()
            elif isinstance(record, Metadata) and record.name == RUN_METADATA:
                metadata = dict(record.metadata)
            elif isinstance(record, Metadata):
                fault = record.metadata.get("fault", "")
            elif isinstance(record, Message):
                stream = _STREAM_OF_TOPIC.get(topics.get(record.channel_id, ""))
                if stream is None or not scene:
                    continue
                if writer is None:
                    writer = RecordingWriter(whole, overwrite)
                    writer.scene(scene, metadata)
                writer.write(stream, record.data, record.sequence, record.log_time)
                copied += 1
    except (Damage, UnicodeDecodeError) as damage:
        fault = f"recovered from {path.name}, which is cut off or damaged ({damage})"
    if writer is None:
        raise RecordingError(f"{path} holds no message of a run: nothing to recover")
    writer.finish({"complete": "no" if fault else "yes", "fault": fault})
    return copied
