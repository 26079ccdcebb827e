"""Machine code on disk: Numba's cache of functions, in our folder."""

import hashlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from numba import config, typeof
from numba.core.caching import FunctionCache, NullCache
from numba.core.runtime import rtsys

from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.jit.folder import cache_folder, code_settings, settings_of_folder

_not_written: list[str] = []  # why the disk did not take something
_swapping = Lock()


@contextmanager
def kept_in(folder: Path) -> Iterator[None]:
    """Let Numba keep what is decorated meanwhile in `folder`.

    Numba reads its configuration when a function is decorated. The configuration is restored: the
    functions of others stay where they are.
    """
    ours = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    with _swapping:
        theirs = {name: getattr(config, name, "") for name in ours}
        vars(config).update(ours)
        try:
            yield
        finally:
            vars(config).update(theirs)


def stored(function: Callable[..., Any], quick: bool = True) -> Any:
    """Numba's cache for a function within `kept_in`; `quick`: see `KernelCache`."""
    try:
        return KernelCache(function, quick)
    except (OSError, RuntimeError) as error:  # a folder or its source cannot be written
        note_not_written(str(error))
        return NullCache()


class KernelCache(FunctionCache):
    """Numba's cache of a function, for a disk that may be full.

    With `quick` it loads machine code without the registries of the compiler. Numba fills these
    first, which takes 0.15 s of a process that compiles nothing. Kernels of hertzloop need nothing
    of them but the allocator of arrays; those of others may.

    A process that changes Numba's settings after the folder was named neither reads nor writes it.
    """

    def __init__(self, function: Callable[..., Any], quick: bool) -> None:
        super().__init__(function)
        self._quick = quick

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code for a signature; None if there is none on the disk."""
        if code_settings() != settings_of_folder():
            return None
        if not self._quick:
            return super().load_overload(sig, target_context)
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if the disk takes it."""
        if code_settings() != settings_of_folder():
            return
        try:
            super().save_overload(sig, data)
        except OSError as error:
            note_not_written(error.strerror or str(error))


def keep(path: Path, content: str | bytes) -> None:
    """Write a file into the folder of kernels, if the disk takes it."""
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        atomic_write(path, content)
    except OSError as error:
        note_not_written(error.strerror or str(error))


def note_not_written(reason: str) -> None:
    """Note that the disk does not take compiled code; say so the first time."""
    if not _not_written:
        message = f"compiled kernels cannot be kept in {cache_folder()}: {reason}"
        print(
            f"hertzloop: {message}. Every process compiles them again. Make room there.",
            file=sys.stderr,
        )
    _not_written.append(reason)


def all_written() -> bool:
    """Whether the disk has taken all that this process has compiled."""
    return not _not_written


def types_digest(*values: Any) -> str:
    """16 hex digits that change with the types of values: kernels are compiled once for each."""
    text = "\0".join(str(typeof(value)) for value in values)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
