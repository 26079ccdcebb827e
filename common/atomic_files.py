"""Files that are written whole or not at all: a full disk, an error or a signal leaves no part."""

import errno
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

_NAMES_OF_OPEN_FILES = (Path("/dev"), Path("/dev/fd"))  # as /dev/stdout; and devices


class NotWritten(OSError):
    """A file cannot be written. The message names it and says why."""

    exit_status = 1

    def __str__(self) -> str:
        return f"cannot write {self.filename}: {self.strerror}"


def in_place(path: Path) -> bool:
    """Whether a file is written where it is: a device such as /dev/null, or a name of an open file.

    Raises NotWritten for a file that is read-only, and for a pipe, a socket and a folder: a pipe
    may wait for its reader for ever.
    """
    if path.parent in _NAMES_OF_OPEN_FILES:
        return True
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if not (stat.S_ISREG(mode) or stat.S_ISCHR(mode)):
        raise NotWritten(errno.EINVAL, "not a regular file", str(path))
    if not os.access(path, os.W_OK):
        raise NotWritten(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return stat.S_ISCHR(mode)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the path of a hidden file, which takes the place of `path` when all has gone well.

    Otherwise the hidden file is removed, and `path` stays as it was. A link stays a link, and an
    existing file keeps its permissions. Raises NotWritten for each OSError of what is inside.
    """
    try:
        if in_place(path):
            yield path
            return
        place = Path(os.path.realpath(path))
        unfinished = place.with_name(f".hertzloop-{os.urandom(8).hex()}{place.suffix}")
        try:
            yield unfinished
            if place.exists():
                unfinished.chmod(stat.S_IMODE(place.stat().st_mode))
            unfinished.replace(place)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        if isinstance(error, NotWritten):
            raise
        raise NotWritten(error.errno, error.strerror or str(error), str(path)) from error


def write_together(texts: Mapping[Path, str], mode: int = 0o666) -> None:
    """Write texts to new files of this mode (less the umask), all or none. Raises NotWritten."""
    with ExitStack() as all_or_none:
        for path, text in texts.items():
            unfinished = all_or_none.enter_context(whole_file(path))
            handle = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with open(handle, "w", encoding="utf-8") as file:
                file.write(text)


def atomic_write(path: Path, content: str | bytes) -> None:
    """Write a text in UTF-8, or bytes. Raises NotWritten."""
    with whole_file(path) as unfinished:
        unfinished.write_bytes(content if isinstance(content, bytes) else content.encode())
