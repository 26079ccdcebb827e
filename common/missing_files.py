"""Why a file that a person named cannot be read, and what to do about it."""

import difflib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

_MOST_LOOKED_AT = 10_000  # names in a folder


def why_unreadable(path: str | Path, error: Exception, remedy: str = "") -> str:
    """Return what is wrong with a file, a name that may be meant, and a remedy.

    Args:
        path: The file.
        error: What reading it has raised.
        remedy: What to do where there is no such file, a sentence with its full stop.

    Returns:
        A clause that follows "cannot be read: ", and sentences; without a remedy it has no full
        stop at its end.
    """
    path = Path(path)
    if not isinstance(error, FileNotFoundError | NotADirectoryError):
        return str(getattr(error, "strerror", None) or error)
    if not path.parent.is_dir():
        words = [f"the folder {path.parent} does not exist"]
    else:
        words = ["there is no such file"]
        meant = close_name(path)
        if meant is not None:
            words.append(f"Did you mean {path.with_name(meant)}?")
    sentences = [word if word.endswith("?") else f"{word}." for word in words]
    text = " ".join([*sentences, remedy] if remedy else sentences)
    return text if remedy else text.removesuffix(".")


@contextmanager
def told_if_unreadable(
    path: Path, named: str, remedy: str, kind: type[ValueError] = ValueError
) -> Iterator[None]:
    """Raise an error of this kind, with one sentence, if a file cannot be read in the context.

    Args:
        path: The file.
        named: What names the file, and its path.
        remedy: As of `why_unreadable`.
        kind: Class of the error.
    """
    try:
        yield
    except (OSError, ValueError) as error:
        why = why_unreadable(path, error, remedy)
        raise kind(f"{named}: cannot be read: {why}") from error


def close_name(path: Path) -> str | None:
    """Return the name of a file beside a missing one that is spelt nearly as it is; None without
    one. A file of another kind is not meant."""
    try:
        with os.scandir(path.parent) as entries:
            names = [one.name for one in islice(entries, _MOST_LOOKED_AT) if one.is_file()]
    except OSError:
        return None
    suffix = path.suffix.lower()
    same_kind = {
        name.lower(): name for name in sorted(names) if Path(name).suffix.lower() == suffix
    }
    close = difflib.get_close_matches(path.name.lower(), same_kind, 1)
    return same_kind[close[0]] if close else None
