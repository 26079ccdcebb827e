"""Finished cases on disk, one line each, so that a killed study goes on where it was.

A line is a JSON object whose last member is a checksum of the text before it. A sweep keeps a row
for each number of a case; `finished_cases.py` keeps the cases of a search.
"""

import fcntl
import json
import os
import zlib
from pathlib import Path
from typing import Any, Self


class JournalError(ValueError):
    """The journal belongs to other work, is in use, or is damaged. The message says which."""

    exit_status = 2


class Journal:
    """An open journal: a header line that names the work, then a line for each finished case.

    Attributes:
        path: The file.
        done: Finished cases by the "case" of their row.
        damaged: Numbers of damaged lines, whose cases are not in `done`.
    """

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """Open a journal, or continue it. Raises JournalError or OSError."""
        self.path = path
        self.done: dict[Any, dict[str, Any]] = {}
        self.damaged: list[int] = []
        self._file = path.open("a+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            whole = self._read(header)
            # A line that a kill has cut off is dropped; its case is not finished.
            self._file.truncate(whole)
            if not whole:
                self._write(header)
        except BaseException as error:
            self._file.close()
            if isinstance(error, BlockingIOError):
                raise JournalError(
                    f"{path} is in use by another command. Wait for its end, or write to another "
                    "folder."
                ) from error
            raise

    def _read(self, header: dict[str, Any]) -> int:
        """Read the finished cases; return the length of all complete lines, bytes."""
        whole = 0
        self._file.seek(0)
        for number, line in enumerate(self._file, 1):
            if not line.endswith(b"\n"):
                break
            row = _unsealed(line)
            if number == 1:
                if row is None:
                    raise JournalError(
                        f"{self.path} is not a journal of finished cases, or its line 1 is "
                        "damaged. Remove the file."
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
                    f"{self.path} holds other unfinished work: its entry '{key}' differs. Finish "
                    "it with its own command, or remove the file."
                )

    def add(self, row: dict[str, Any]) -> None:
        """Write a finished case; the operating system has it when this returns."""
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
    text = json.dumps(row).encode()[:-1]  # without the brace
    return text + _SEAL + f'{zlib.crc32(text):08x}"}}\n'.encode()


def _unsealed(line: bytes) -> dict[str, Any] | None:
    """Return the row of a line; None if it is damaged."""
    text, _, rest = line.rpartition(_SEAL)
    if rest != f'{zlib.crc32(text):08x}"}}\n'.encode():
        return None
    return dict(json.loads(text + b"}"))
