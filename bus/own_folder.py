"""Temporary folders that do not outlive their process for long, however it ends."""

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

RUN = "hertzloop-run-"
_YOUNG_S = 60.0  # in which whoever made a folder has surely locked it


@contextmanager
def own_folder(prefix: str = RUN, parent: str | None = None) -> Iterator[str]:
    """A folder with mode 700 that is removed at the end of the context.

    It is locked until then. A process that is killed leaves its folder without a lock, and the next
    call with the same prefix removes it. Raises OSError.
    """
    parent = parent or tempfile.gettempdir()
    _sweep(prefix, parent)
    folder = tempfile.mkdtemp(prefix=prefix, dir=parent)
    try:
        handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_SH)
            yield folder
        finally:
            os.close(handle)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _sweep(prefix: str, parent: str) -> None:
    """Remove what this user's processes left here that had no time to do so."""
    for folder in Path(parent).glob(f"{prefix}*"):
        with suppress(OSError):
            stat = folder.lstat()
            if stat.st_uid != os.getuid() or time.time() - stat.st_mtime < _YOUNG_S:
                continue
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(handle)
