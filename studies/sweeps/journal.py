"""Finished cases on disk, one line each, so that a killed sweep or search goes on where it was.

A line is a JSON object whose last member is a checksum of what stands before it.
"""

import fcntl
import json
import os
import zlib
from pathlib import Path
from typing import Any, Self


class JournalError(ValueError):
    """The journal found is of other work, in use, or damaged; the message says which."""


class Journal:
    """An open journal: a header line that names the work, then a line a finished case.

    `damaged`: numbers of the lines found that are not as they were written; their cases are not
    among those `done`.
    """

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """Open or go on with `path`. Raises JournalError, or OSError."""
        self.path = path
        self.done: dict[Any, dict[str, Any]] = {}  # by the "case" of a row
        self.damaged: list[int] = []
        self._file = path.open("a+b")
        try:
            self._lock()
            whole = self._read(header)
            # A line that a kill has torn is dropped; its case is not finished.
            self._file.truncate(whole)
            if not whole:
                self._write(header)
        except BaseException:
            self._file.close()
            raise

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise JournalError(
                f"{self.path} is in use by a command that is running; wait for its end, or write "
                "elsewhere"
            ) from error

    def _read(self, header: dict[str, Any]) -> int:
        """Take over the finished cases; the length of the whole lines in bytes."""
        whole = 0
        self._file.seek(0)
        for number, line in enumerate(self._file, 1):
            if not line.endswith(b"\n"):
                break
            row = _unsealed(line)
            if number == 1:
                if row is None:
                    raise JournalError(
                        f"{self.path} is no journal of finished cases, or its line 1 is damaged; "
                        "remove the file"
                    )
                self._compare(row, header)
            elif row is None:
                self.damaged.append(number)
            else:
                self.done[row["case"]] = row
            whole += len(line)
        return whole

    def _compare(self, found: dict[str, Any], header: dict[str, Any]) -> None:
        for key, value in json.loads(json.dumps(header)).items():
            if found.get(key) != value:
                raise JournalError(
                    f"{self.path} holds unfinished work with another {key}; finish that with "
                    "its own command, or remove the file"
                )

    def add(self, row: dict[str, Any]) -> None:
        """Note a finished case; it is with the operating system when this returns."""
        self.done[row["case"]] = row
        self._write(row)

    def _write(self, row: dict[str, Any]) -> None:
        self._file.write(_sealed(row))
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.fsync(self._file.fileno())
        self._file.close()


_SEAL = b', "crc32": "'


def _sealed(row: dict[str, Any]) -> bytes:
    """A row as a line with its checksum."""
    text = json.dumps(row).encode()[:-1]  # without the brace
    return text + _SEAL + f'{zlib.crc32(text):08x}"}}\n'.encode()


def _unsealed(line: bytes) -> dict[str, Any] | None:
    """The row of a line; None if it is not as it was written."""
    text, _, rest = line.rpartition(_SEAL)
    if rest != f'{zlib.crc32(text):08x}"}}\n'.encode():
        return None
    return dict(json.loads(text + b"}"))
