"""The folder of compiled kernels: named by their sources, and written by this user alone.

Numba notices an edit of a kernel's own file, but not of a callee in another file (numba #1833), nor
settings that change the code it makes (numba #10821). So the folder is named by a digest of all
sources that hold kernels and of these settings. Numba unpickles and runs what lies
in it: nobody else may write there.
"""

import hashlib
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
from atexit import register
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import llvmlite
import numba
from numba import config, typeof

from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.jit import shipped

# A file that holds kernels imports one of these.
_HOLDS_KERNELS = re.compile(
    rb"^\s*(?:from\s+(?:numba\b|hertzloop\.common\.jit\s|hertzloop\.plant\.lanes\s|"
    rb"hertzloop\.common\s+import\s.*\bjit\b)|import\s+(?:numba|hertzloop\.common\.jit)\b)",
    re.M,
)
# Numba's settings that change the code it makes. The processor is not among them: Numba tells
# processors and their features apart itself.
_CODE_SETTINGS = (
    "OPT",
    "LOOP_VECTORIZE",
    "SLP_VECTORIZE",
    "BOUNDSCHECK",
    "DEBUGINFO_DEFAULT",
    "EXTEND_VARIABLE_LIFETIMES",
    "DISABLE_INTEL_SVML",
    "USING_SVML",
    "LLVM_REFPRUNE_PASS",
    "LLVM_REFPRUNE_FLAGS",
    "NRT_STATS",
    "DEBUG_NRT",
    "DEBUG_ARRAY_OPT_RUNTIME",
    "PARFOR_MAX_TUPLE_SIZE",
    "JIT_COVERAGE",
)
# Numba tells minor versions apart, and none of its kernels holds what a smaller one changes.
_PYTHON = f"{sys.implementation.cache_tag} {platform.system()} {platform.machine()}"
# The folder that holds hertzloop. `common` is a link in a clone, so it is resolved last.
_ROOT = Path(__file__).absolute().parents[3].resolve()
_ROOM = 64_000_000  # bytes: some times what is compiled for all scenes
_swapping = Lock()


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels, of mode 700, in NUMBA_CACHE_DIR or ~/.cache/hertzloop.

    Where nothing can be written there, or others could write there, it lies in a folder that lives
    as long as this process.
    """
    # Numba tells checkouts apart by their path, and so does the name.
    name = f"{code_digest()}-{hashlib.sha256(bytes(_ROOT)).hexdigest()[:8]}"
    given = os.environ.get("NUMBA_CACHE_DIR")
    try:
        base = Path(given).absolute() if given else Path.home() / ".cache" / "hertzloop"
        _make_private(base)
        _make_private(base / name)
    except (OSError, RuntimeError) as error:  # a user without a home
        base = _temporary()
        _make_private(base / name)
        os.environ["NUMBA_CACHE_DIR"] = str(base)  # for children
        where = f"hertzloop: compiled kernels are kept in {base}, while this command runs"
        print(f"{where}: {error}. Name another folder by NUMBA_CACHE_DIR.", file=sys.stderr)
    shipped.unpack(code_digest(), base / name)
    return base / name


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


@cache
def has_room() -> bool:
    """Whether the disk takes compiled kernels; says so where it does not."""
    free = shutil.disk_usage(cache_folder()).free
    if free < _ROOM:
        print(
            f"hertzloop: compiled kernels cannot be kept in {cache_folder()}: {free / 1e6:.0f} MB "
            "are free. Every process compiles them again. Make room there.",
            file=sys.stderr,
        )
    return free >= _ROOM


def keep(path: Path, content: str | bytes) -> None:
    """Write a file into the folder of kernels, if the disk takes it."""
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        atomic_write(path, content)


def types_digest(*values: Any) -> str:
    """16 hex digits that change with the types of values: kernels are compiled once for each."""
    text = "\0".join(str(typeof(value)) for value in values)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _make_private(folder: Path) -> None:
    """Make a folder that only this user can write to, of mode 700, unless it is there. Raises
    OSError, also for a link or the folder of somebody else."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = folder.lstat()
    if stat.S_ISLNK(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{folder} is not a folder that only this user can write to")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"{folder} cannot be written")


@cache
def code_digest() -> str:
    """16 hex digits that change with any source of kernels, and with what compiles them."""
    digest = hashlib.sha256()
    settings = [getattr(config, name, None) for name in _CODE_SETTINGS]
    for what in (_PYTHON, numba.__version__, llvmlite.__version__, repr(settings)):
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


def _temporary() -> Path:
    """A folder that is gone with this process."""
    folder, ours = tempfile.mkdtemp(prefix="hertzloop-"), os.getpid()

    def remove() -> None:
        if os.getpid() == ours:  # not in a fork
            shutil.rmtree(folder, ignore_errors=True)

    register(remove)
    return Path(folder)
