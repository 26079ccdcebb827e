"""What a compiled kernel is, and where it is kept: by its sources, where only this user writes.

Numba notices an edit of a kernel's own file, not of a callee in another file (numba #1833), so
the folder is named after all sources that hold kernels. What is in it is unpickled and run.
"""

import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
from atexit import register
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import llvmlite
import numba
from numba import config, typeof
from numba.core import event
from numba.core.caching import FunctionCache, NullCache
from numba.core.runtime import rtsys

from hertzloop.whole_files import write_whole

# A file that holds kernels imports one of these.
_HOLDS_KERNELS = re.compile(
    rb"^\s*(?:from\s+(?:numba\b|hertzloop\.jit\s|hertzloop\.jit\.(?:by_type|apart)\s|"
    rb"hertzloop\s+import\s.*\bjit\b)|import\s+(?:numba|hertzloop\.jit)\b)",
    re.M,
)
_ROOT = Path(__file__).resolve().parent.parent.parent
_CHOSEN = "HERTZLOOP_CACHE"  # tells children a place other than the usual one


@cache
def code_digest() -> str:
    """16 hex digits that change with any source of kernels, and with what compiles them."""
    digest = hashlib.sha256()
    for what in (sys.version, numba.__version__, llvmlite.__version__):
        digest.update(what.encode() + b"\0")
    for name, text in sorted(kernel_sources().items()):
        digest.update(name.encode() + b"\0" + hashlib.sha256(text).digest())
    return digest.hexdigest()[:16]


def kernel_sources() -> dict[str, bytes]:
    """Source files that hold compiled functions, by their path in the folder that holds hertzloop.

    In a clone, the folders of the package are links, and the benchmarks hold kernels too.
    """
    in_clone = (_ROOT / "hertzloop" / "plant").is_symlink()
    found = {}
    for package in ("hertzloop", "benchmarks") if in_clone else ("hertzloop",):
        for folder, _, names in os.walk(_ROOT / package, followlinks=True):
            for path in (os.path.join(folder, name) for name in names if name.endswith(".py")):
                with open(path, "rb") as file:
                    text = file.read()
                # Most files name neither, and the pattern is slow.
                if (b"numba" in text or b"jit" in text) and _HOLDS_KERNELS.search(text):
                    found[os.path.relpath(path, _ROOT)] = text
    return found


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels, of mode 700, in the first safe and writable place.

    That is NUMBA_CACHE_DIR, if set, then ~/.cache/hertzloop, a folder of this user among the
    temporary ones, and at last one that lives as long as this process.
    """
    # Numba tells checkouts apart by their path; whether all is compiled is noted a folder.
    name = f"{code_digest()}-{hashlib.sha256(bytes(_ROOT)).hexdigest()[:8]}"
    refused = []
    for base in _places():
        try:
            own(base)
            own(base / name, alone=True)
            break
        except NotOurs as error:
            refused.append(str(error))
        except OSError:  # not writable, or no such thing
            continue
    else:
        base = _private()
        own(base / name, alone=True)
    if base != next(_places()):
        os.environ[_CHOSEN] = str(base)
    if refused:
        said = f"hertzloop: compiled kernels are kept in {base}, since {'; '.join(refused)}"
        print(said, file=sys.stderr)
    return base / name


def _places() -> Iterator[Path]:
    """Folders to keep kernels in, the best first."""
    chosen = os.environ.get(_CHOSEN)
    if chosen and os.path.lexists(chosen):
        yield Path(chosen)
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        yield Path(given).resolve()
    with suppress(RuntimeError):  # a user without a home
        yield (Path.home() / ".cache").resolve() / "hertzloop"
    yield Path(tempfile.gettempdir()).resolve() / f"hertzloop-{os.getuid()}"


def _private() -> Path:
    """A folder that is gone with this process."""
    folder, ours = tempfile.mkdtemp(prefix="hertzloop-"), os.getpid()

    def remove() -> None:
        if os.getpid() == ours:  # not in a fork
            shutil.rmtree(folder, ignore_errors=True)

    register(remove)
    return Path(folder)


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


def types_digest(*values: Any) -> str:
    """16 hex digits that change with the types of values: kernels are compiled once for each."""
    text = "\0".join(str(typeof(value)) for value in values)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


_refused: list[str] = []


def all_kept() -> bool:
    """Whether the disk has taken all that this process has compiled."""
    return not _refused


def note_refused(reason: str) -> None:
    """Note that the disk does not take compiled code; say so the first time."""
    if not _refused:
        said = f"compiled kernels cannot be kept in {cache_folder()}: {reason}"
        print(f"hertzloop: {said}. Every process compiles them again. Make room there.",
              file=sys.stderr)  # fmt: skip
    _refused.append(reason)


def keep(path: Path, content: str | bytes) -> None:
    """Write a file into the folder of kernels, if the disk takes it."""
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        note_refused(error.strerror or str(error))


_swapping = Lock()


@contextmanager
def kept_in(folder: Path) -> Iterator[None]:
    """Let Numba keep what is decorated meanwhile in `folder`, and leave all else as it was.

    Numba looks at its configuration when a function is decorated: neither what was imported
    first nor the environment decides, and the functions of others stay where they are.
    """
    ours = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    with _swapping:
        theirs = {name: getattr(config, name, "") for name in ours}
        vars(config).update(ours)
        try:
            yield
        finally:
            vars(config).update(theirs)


def stored(function: Callable[..., Any], quick: bool) -> Any:
    """Numba's cache for a function within `kept_in`; with `quick` a QuickCache."""
    try:
        return (QuickCache if quick else LenientCache)(function)
    except (OSError, RuntimeError) as error:  # a folder or its source cannot be written
        note_refused(str(error))
        return NullCache()


class LenientCache(FunctionCache):
    """Numba's cache of a function, which does without a disk that does not take the code."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if the disk takes it."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            note_refused(error.strerror or str(error))


class QuickCache(LenientCache):
    """A cache without what only a compiler needs.

    Before it loads machine code, Numba registers all that it knows to compile, which takes 0.15 s
    of a process. When it compiles, it does that again. Machine code of this package calls the
    allocator of arrays and nothing else that is registered; that of others may.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code for a signature; None if there is none on the disk."""
        rtsys.initialize(target_context)  # the allocator of arrays
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Notice(event.Listener):
    def __init__(self, tell: Callable[[bool], None]) -> None:
        self._tell, self._depth = tell, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._tell(True)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._tell(False)


@contextmanager
def noticed(tell: Callable[[bool], None]) -> Iterator[None]:
    """Call tell(True) when this process begins to compile a kernel, tell(False) when that kernel is
    done; not for a kernel that is loaded from the cache."""
    with event.install_listener("numba:compile", _Notice(tell)):
        yield


class _Names(event.Listener):
    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        ours = function.__module__.startswith("hertzloop.") and "<" not in function.__qualname__
        self._tell(function.__name__.strip("_").replace("_", " ") if ours else "")


@contextmanager
def each_compiled(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` after every function that this process has compiled meanwhile, with its name in
    words; that of a part of Numba is empty."""
    with event.install_listener("numba:compile", _Names(tell)):
        yield
