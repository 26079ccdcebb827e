"""What a scene says of a file of latencies, and the latencies of a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from hertzloop.scene.errors import sentence
from hertzloop.scene.tables import SceneTable

MOST_LATENCIES = 1_000_000
IN_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0, "μs": 1.0, "ns": 1e-3}


class Latencies(NamedTuple):
    """Latencies, us, in the order of time unless `ordered` is false, as for a histogram."""

    values_us: list[float]
    ordered: bool = True


class TraceFile(SceneTable):
    """A file of latencies, and what its content leaves open.

    Attributes:
        file: The file.
        column: Heading of the column of latencies in a text table.
        sample: Heading of the column with the time stamps of samples.
        command: Heading of the column with the time stamps of commands.
        unit: Unit of the numbers, if the file does not state it: s, ms, us or ns.
        thread: Thread of a histogram of cyclictest.
        offset_us: Added to every latency, us: by how much the clock of the samples is ahead of the
            clock of the commands.
    """

    file: Path
    column: str | None = None
    sample: str | None = None
    command: str | None = None
    unit: Literal[(*IN_US,)] | None = None  # type: ignore[valid-type]
    thread: int | None = None
    offset_us: float = 0.0

    @classmethod
    def from_table(cls, table: Mapping[str, Any], folder: Path) -> "TraceFile":
        """Return the file that a table of a scene names, relative to `folder`.

        Raises:
            ValueError: a key is unknown, or its value is impossible.
        """
        try:
            found = cls.model_validate(table)
        except ValidationError as error:
            raise ValueError(sentence(error, cls, ("controller", "latency_trace"))) from error
        if (found.sample is None) != (found.command is None):
            raise ValueError(
                "controller.latency_trace: sample and command belong together. Give both or none"
            )
        return found.replaced(file=folder / found.file)

    def refuse(self, what: str, *names: str) -> None:
        """Raise ValueError for a given key that has no meaning for `what`."""
        for name in names:
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: has no meaning for {what}. Leave it out")
