"""Folders that nobody else can put a file into."""

import os
import stat
from contextlib import suppress
from pathlib import Path


class NotOurs(Exception):
    """Somebody else could have written into a folder; the message says why and the remedy."""


def own(folder: Path, *, alone: bool = False) -> None:
    """Make sure that only this user (and root) can write to `folder`; makes it, of mode 700.

    With `alone`, others cannot read it either. `folder` is absolute. Raises NotOurs, or OSError.
    """
    if not os.path.lexists(folder):
        _make(folder)
    for parent in folder.parents:
        _check_parent(parent)
    found = folder.lstat()
    if stat.S_ISLNK(found.st_mode):
        raise NotOurs(f"{folder} is a symbolic link; remove it")
    if not stat.S_ISDIR(found.st_mode):
        raise NotADirectoryError(str(folder))
    if found.st_uid != os.getuid():
        raise NotOurs(f"{folder} belongs to user {found.st_uid}, not to {os.getuid()}; remove it")
    if found.st_mode & (0o077 if alone else 0o022):
        raise NotOurs(
            f"{folder} is open to other users (mode {stat.S_IMODE(found.st_mode):o}); "
            "remove it, or chmod 700 if you trust what is in it"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(str(folder))


def _make(folder: Path) -> None:
    """Make a folder and those above it that are missing, all of mode 700."""
    if not folder.parent.is_dir():
        _make(folder.parent)
    with suppress(FileExistsError):  # by another process, just now; checked like any other
        folder.mkdir(mode=0o700)


def _check_parent(folder: Path) -> None:
    """A folder above: whoever can write to it could put another in our folder's place."""
    found = folder.lstat()
    if found.st_uid not in (os.getuid(), 0):
        raise NotOurs(f"{folder} belongs to user {found.st_uid}, not to {os.getuid()} or root")
    # In a sticky folder, as /tmp, nobody moves what belongs to others.
    if found.st_mode & 0o022 and not found.st_mode & stat.S_ISVTX:
        raise NotOurs(
            f"others can write to {folder} (mode {stat.S_IMODE(found.st_mode):o}); chmod go-w it"
        )
