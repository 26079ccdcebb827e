"""Finished cases of a sweep on disk, one line each, so that a killed sweep goes on where it was."""

import json
import os
from pathlib import Path
from typing import Any, Self


class JournalError(ValueError):
    """The journal found belongs to another sweep; the message says what differs."""


class Journal:
    """An open journal: a header line that names the sweep, then a line a finished case."""

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """Open or go on with `path`. Raises JournalError, or OSError."""
        self.path = path
        self.done: dict[int, dict[str, Any]] = {}
        whole = 0
        if path.exists():
            whole = self._read(header)
        self._file = path.open("r+b" if whole else "wb")
        if not whole:
            self._write(header)
        else:
            # A line that a kill has torn is dropped; its case is not finished.
            self._file.truncate(whole)
            self._file.seek(whole)

    def _read(self, header: dict[str, Any]) -> int:
        """Take over the finished cases; the length of the whole lines in bytes."""
        whole, found = 0, None
        with self.path.open("rb") as file:
            for line in file:
                if not line.endswith(b"\n"):
                    break
                row = json.loads(line)
                if found is None:
                    found = row
                    self._compare(found, header)
                else:
                    self.done[row["case"]] = row
                whole += len(line)
        return whole

    def _compare(self, found: dict[str, Any], header: dict[str, Any]) -> None:
        for key, value in json.loads(json.dumps(header)).items():
            if found.get(key) != value:
                raise JournalError(
                    f"{self.path} holds an unfinished sweep with another {key}; finish that one "
                    "with its own command, or remove the file"
                )

    def add(self, row: dict[str, Any]) -> None:
        """Note a finished case; it is with the operating system when this returns."""
        self.done[row["case"]] = row
        self._write(row)

    def _write(self, row: dict[str, Any]) -> None:
        self._file.write(json.dumps(row).encode() + b"\n")
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.fsync(self._file.fileno())
        self._file.close()
