"""What a recording file is made of: its format version, and the names of its parts."""

from hertzloop.bus import streams
from hertzloop.bus.messages_pb2 import Hello

FORMAT_VERSION = "1"  # a new number for each change that a reader of the old one cannot read
FORMAT_KEY = "format_version"  # in the metadata of the run
# In the header of the file. Neither place has a checksum of its own: with two, a damaged byte in
# one of them does not make a recording unreadable.
PROFILE = f"hertzloop-{FORMAT_VERSION}"
SCENE_ATTACHMENT = "scene.toml"
LAW_ATTACHMENT = "law"
RUN_METADATA, RESULT_METADATA = "run", "result"
LIBRARY, EXPORT_LIBRARY = "hertzloop", "hertzloop export"  # in the headers of files
TOPICS = tuple(dict.fromkeys(stream.topic for stream in streams.STREAMS.values()))
_LONGEST_SHOWN = 20  # characters of a format version: it comes from a file


def run_metadata(hello: Hello, note: str = "") -> dict[str, str]:
    """Return the description of a run for its recording, from the hello of the plant and the note
    of the user."""
    pace = {"pace": f"{hello.pace:g}"} if hello.pace else {}
    repeats = {"repeats": f"{hello.repeats:x}"} if hello.repeats else {}
    return {
        "scene": hello.scene,
        "run_id": f"{hello.run_id:x}",
        "seed": str(hello.seed),
        "steps": str(hello.steps),
        "step_ns": str(hello.step_ns),
        "versions": hello.versions,
        "law": hello.law,
        "law_digest": hello.law_digest,
        **pace,
        **repeats,
        **({"note": note} if note else {}),
    }


def other_format(metadata: dict[str, str]) -> str:
    """Return which format version a recording has, if this version of hertzloop does not read it.

    Args:
        metadata: Metadata `run` of the file.

    Returns:
        Words that follow the name of the file; empty for FORMAT_VERSION.
    """
    found = metadata.get(FORMAT_KEY)
    if found == FORMAT_VERSION:
        return ""
    if found is None:
        return "has no format version"
    shown = "".join(c for c in found if c.isprintable())[:_LONGEST_SHOWN]
    return f"has format version '{shown}'"
