"""`hertzloop repair` beside recoverers for any MCAP file, on the same damaged files.

MCAP's own command `mcap recover` is a program in Rust that no package index holds. It reads records
one after another, does not check the checksums of chunks, and stops at the first record or chunk
that it cannot read. The reader of MCAP's Python library does the same, and stands in for it here.
pymcap-cli is a separate program, with a recovery of its own.
"""

import contextlib
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.options import JsonOption
from hertzloop.common.optional_dependencies import need
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.run_options import RunOptions
from hertzloop.recordings.recovery import recover
from hertzloop.recordings.writer import RecordingError

_SEED, _HEAD = 1, 9  # of the damages; bytes before the content of a record
_CUTS = (0.1, 0.9)  # of the length of a file: where it is cut off
_PYMCAP_CODES = (0, 1, 3)  # everything, nothing, or a part could be recovered
_WHOLE = "none"

OURS, LIBRARY = "hertzloop repair", "MCAP's linear reader"
PYMCAP = "pymcap-cli recover -a"

Key = tuple[str, int, int, bytes]  # topic, number, time, ns, and bytes of a message
Recoverer = Callable[[Path, Path], None]  # from a damaged file to a new one


@dataclass
class Recovered:
    """Copies with one kind of damage, as one program recovers them.

    Attributes:
        damage: Kind of damage.
        program: The program that recovers.
        copies: Number of damaged files.
        opened: Number of new files that MCAP's reader reads to the end with all checksums.
        recovered: Share of the written messages that can be read from the new files, per cent; the
            mean over the copies.
        altered: Number of messages in the new files that were never written.
    """

    damage: str
    program: str
    copies: int = 0
    opened: int = 0
    recovered: float = 0.0
    altered: int = 0


def by_hertzloop(damaged: Path, new: Path) -> None:
    """As `hertzloop repair` does."""
    with contextlib.suppress(RecordingError):  # nothing to recover
        recover(damaged, new, overwrite=True)


def by_library(damaged: Path, new: Path) -> None:
    """Copy record by record, up to the first that cannot be read."""
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    with damaged.open("rb") as source, new.open("wb") as target:
        writer, begun = Writer(target), False
        # The library raises errors of many kinds for damaged bytes.
        with contextlib.suppress(Exception):
            for record in StreamReader(source).records:
                match record:
                    case Header():
                        writer.start(record.profile, record.library)
                        begun = True
                    case Schema():
                        schemas[record.id] = writer.register_schema(
                            record.name, record.encoding, record.data
                        )
                    case Channel():
                        channels[record.id] = writer.register_channel(
                            record.topic,
                            record.message_encoding,
                            schemas[record.schema_id],
                            record.metadata,
                        )
                    case Message():
                        writer.add_message(
                            channels[record.channel_id],
                            record.log_time,
                            record.data,
                            record.publish_time,
                            record.sequence,
                        )
                    case Attachment():
                        writer.add_attachment(
                            record.create_time,
                            record.log_time,
                            record.name,
                            record.media_type,
                            record.data,
                        )
                    case Metadata():
                        writer.add_metadata(record.name, record.metadata)
        if begun:
            writer.finish()


def by_pymcap(damaged: Path, new: Path) -> None:
    """With the option -a, which unpacks every chunk; without it, some are copied as they are."""
    words = ("recover", str(damaged), "-o", str(new), "-f", "-a")
    done = subprocess.run(
        (sys.executable, "-m", "pymcap_cli.cli", *words),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in _PYMCAP_CODES:
        raise RuntimeError(f"pymcap-cli ended with {done.returncode}: {done.stderr}")


RECOVERERS: dict[str, Recoverer] = {
    OURS: by_hertzloop,
    LIBRARY: by_library,
    PYMCAP: by_pymcap,
}


def records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, first byte and end of each record of a whole file."""
    at = 8
    while at + _HEAD < len(content):
        end = at + _HEAD + int.from_bytes(content[at + 1 : at + _HEAD], "little")
        yield content[at], at, end
        at = end


def damaged_copies(content: bytes, each: int) -> Iterator[tuple[str, bytes]]:
    """Kind of damage, and a copy with it."""
    rng = np.random.default_rng(_SEED)
    found = list(records(content))
    chunks = [(at, end) for kind, at, end in found if kind == Opcode.CHUNK]
    [data_end] = [at for kind, at, _ in found if kind == Opcode.DATA_END]
    yield _WHOLE, content
    for share in np.linspace(*_CUTS, each):
        yield "cut off", content[: int(share * len(content))]
    for _ in range(each):
        at, end = chunks[rng.integers(len(chunks))]
        place = int(rng.integers((at + end) // 2, end))  # the second half holds packed messages
        yield "a byte in a chunk", _with_other_byte(content, place, rng)
    for _ in range(each):
        at, _end = chunks[rng.integers(len(chunks))]
        yield "the length of a chunk", _with_other_byte(content, at + 1 + int(rng.integers(4)), rng)
    yield "no index", content[:data_end]


def _with_other_byte(content: bytes, at: int, rng: np.random.Generator) -> bytes:
    return content[:at] + bytes([content[at] ^ int(rng.integers(1, 256))]) + content[at + 1 :]


def messages(path: Path) -> Counter[Key]:
    """Messages of a file, as far as MCAP's reader gets without looking at checksums."""
    found: Counter[Key] = Counter()
    with contextlib.suppress(Exception), path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            found[channel.topic, message.sequence, message.log_time, message.data] += 1
    return found


def _opens(path: Path) -> bool:
    """Whether MCAP's reader reads a file to the end, with all checksums."""
    try:
        with path.open("rb") as file:
            return all(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))
    except Exception:  # the library raises errors of many kinds
        return False


def recorded(folder: Path, duration_s: float) -> Path:
    """A run of `aluminium-3mm`, in many messages and chunks."""
    path = folder / "whole.mcap"
    settings = [f"run.duration_s={duration_s}", "run.accuracy=0.1", "sensors.bits=16"]
    record_in_process(
        load("aluminium-3mm", settings), path, RunOptions(horizon=100), compiled=False
    )
    return path


def compared(whole: Path, each: int) -> list[Recovered]:
    """Recover damaged copies of a recording by every program."""
    content, written = whole.read_bytes(), messages(whole)
    damaged, new = whole.with_name("damaged.mcap"), whole.with_name("new.mcap")
    results: dict[tuple[str, str], Recovered] = {}
    for damage, copy in tracked("damaged files", damaged_copies(content, each)):
        damaged.write_bytes(copy)
        for program, recoverer in RECOVERERS.items():
            one = results.setdefault((damage, program), Recovered(damage, program))
            new.unlink(missing_ok=True)
            recoverer(damaged, new)
            found = messages(new)
            if damage == _WHOLE and found != written:  # it was called wrongly, or is of no use
                raise RuntimeError(f"{program} does not copy an undamaged file")
            share = 100.0 * (found & written).total() / written.total()
            one.recovered = (one.copies * one.recovered + share) / (one.copies + 1)
            one.copies += 1
            one.opened += _opens(new)
            one.altered += (found - written).total()
    return list(results.values())


def main(
    out_dir: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Recover damaged recordings with hertzloop and with programs for any MCAP file.

    Example: python -m benchmarks.compare_repair --quick
    """
    with results_in(out_dir, "compare-repair", json_file=json_file) as results:
        need("pymcap_cli")
        with TemporaryDirectory(prefix="hertzloop-") as folder:
            whole = recorded(Path(folder), 0.02 if quick else 0.2)
            found = compared(whole, 2 if quick else 20)
        results.write("repair", found)
        results.table(
            "messages recovered of those written",
            {
                "damage": "{.damage}",
                "program": "{.program}",
                "recovered, %": "{.recovered:.1f}",
                "altered": "{.altered}",
                "opens": lambda one: f"{one.opened} of {one.copies}",
            },
            found,
            text=2,
        )
        damaged = [one for one in found if one.damage != _WHOLE]
        total = {
            name: sum(one.recovered * one.copies for one in damaged if one.program == name)
            / sum(one.copies for one in damaged if one.program == name)
            for name in RECOVERERS
        }
        altered = {
            name: sum(one.altered for one in damaged if one.program == name) for name in RECOVERERS
        }
        parts = [f"{name} {total[name]:.1f} % ({altered[name]} altered)" for name in RECOVERERS]
        results.conclude(f"Of all messages these recover: {', '.join(parts)}.")


if __name__ == "__main__":
    start("benchmarks.compare_repair")
