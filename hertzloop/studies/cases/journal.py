"""Finished cases on disk, one line each, so that a killed study goes on where it was.

A line is a JSON object whose last member is a checksum of the text before it. A sweep keeps a row
for each number of a case. A search keeps its cases by their values: it asks for the same cases in
the same order when it is started again, since its seed is given.
"""

import fcntl
import hashlib
import json
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from hertzloop.results.spans import Span
from hertzloop.studies.cases.evaluate import Numbered, Pool, chunked
from hertzloop.studies.cases.rows import Rows


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


class FinishedCases:
    """Finished cases of a search in an open journal.

    Attributes:
        journal: The journal.
        found: Number of cases that an earlier start has finished.
        ran: Number of cases that were run since.
    """

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self.found, self.ran = len(journal.done), 0

    def skipping_finished(self, pool: Pool) -> Pool:
        """Return a pool that runs only the cases that the journal lacks, each of them once."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            setup = _digest([toml, span])
            open_: Numbered = []
            named: dict[int, str] = {}  # of the cases to run
            again: dict[str, list[int]] = {}  # the numbers under which a case is wanted
            for number, values in (case for chunk in chunks for case in chunk):
                name = _digest([setup, values])
                if name not in self.journal.done and name not in again:
                    open_.append((number, values))
                    named[number] = name
                again.setdefault(name, []).append(number)
            for rows in pool(toml, span, chunked(open_)):
                for row in rows:
                    self.journal.add({"case": named[row["case"]], "row": row})
                self.ran += len(rows)
            for name, numbers in again.items():
                row = self.journal.done[name]["row"]
                yield [row | {"case": number} for number in numbers]

        return results


@contextmanager
def kept(folder: Path, name: str, header: dict[str, Any]) -> Iterator[FinishedCases]:
    """Open the journal of a search, FOLDER/NAME-DIGEST.partial; remove it when the work is done.

    Args:
        folder: Folder of the journal.
        name: Name of the work.
        header: All that decides which cases are asked for, and their bits; the digest is of this.

    Raises:
        JournalError: the journal is in use, or damaged.
        OSError: the journal cannot be written.
    """
    path = folder / f"{name}-{_digest(header)[:8]}.partial"
    with Journal(path, header) as journal:
        yield FinishedCases(journal)
    path.unlink()


def _digest(what: Any) -> str:
    return hashlib.blake2b(json.dumps(what, sort_keys=True).encode(), digest_size=12).hexdigest()
