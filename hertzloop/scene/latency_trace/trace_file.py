"""What a scene says of a file of latencies, and the latencies of a file."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from hertzloop.scene.errors import shown

MOST_LATENCIES = 1_000_000
IN_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0, "μs": 1.0, "ns": 1e-3}


class Latencies(NamedTuple):
    """Latencies, us, in the order of time unless `ordered` is false, as for a histogram."""

    values_us: list[float]
    ordered: bool = True


@dataclass(frozen=True)
class TraceFile:
    """A file of latencies, and what its content leaves open.

    Attributes:
        file: The file.
        column: Heading of the column of latencies in a text table.
        sample: Heading of the column with the time stamps of samples.
        command: Heading of the column with the time stamps of commands.
        unit: Unit of the numbers, if the file does not state it: s, ms, us or ns.
        thread: Thread of cyclictest.
        topic: Topic of an MCAP file whose messages have a publish time and a log time.
        offset_us: Added to every latency, us: by how much the clock of the samples is ahead of the
            clock of the commands.
    """

    file: Path
    column: str | None = None
    sample: str | None = None
    command: str | None = None
    unit: str | None = None
    thread: int | None = None
    topic: str | None = None
    offset_us: float = 0.0

    @classmethod
    def from_table(cls, table: Mapping[str, Any], folder: Path) -> "TraceFile":
        """Return the file that a table of a scene names, relative to `folder`.

        Raises:
            ValueError: a key is unknown, or its value has another type.
        """
        where = "controller.latency_trace"
        known = [one.name for one in fields(cls)]
        if unknown := sorted(set(table) - set(known)):
            raise ValueError(f"{where}.{unknown[0]}: unknown key. Use {', '.join(known)}")
        numbers: dict[str, tuple[type, ...]] = {"thread": (int,), "offset_us": (int, float)}
        for name, value in table.items():
            if not isinstance(value, numbers.get(name, (str,))) or isinstance(value, bool):
                raise ValueError(f"{where}.{name} = {shown(value)}: has the wrong type")
        if table.get("unit", "s") not in IN_US:
            raise ValueError(f"{where}.unit = {shown(table['unit'])}: use s, ms, us or ns")
        if ("sample" in table) != ("command" in table):
            raise ValueError(f"{where}: sample and command belong together. Give both or none")
        return cls(**{**table, "file": folder / table["file"]})

    def refuse(self, what: str, *names: str) -> None:
        """Raise ValueError for a given key that has no meaning for `what`."""
        for name in names:
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: has no meaning for {what}. Leave it out")
