"""Laws by what a scene calls them: a shipped name, a file, a module, an entry point."""

import ast
import difflib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import os
import re
import shlex
import sys
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic.fields import FieldInfo

from hertzloop.common.missing_files import why_unreadable
from hertzloop.common.text_files import python_text
from hertzloop.controller.loading import callbacks
from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.controller.loading.identity import TEXT_DIGITS, identify, law_digest, same_law
from hertzloop.controller.loading.interface import check_home
from hertzloop.controller.loading.law import Law, LawError, error_text
from hertzloop.controller.loading.library import library_law
from hertzloop.controller.loading.unit import unit_law

_ENDINGS = (".py", ".so", ".dylib", ".fmu", ".c")
_SOURCE = (".c", ".cc", ".cpp", ".cxx")
ENTRY_POINTS = "hertzloop.laws"
NO_CONTROL = "off"  # the law that stands for none
_FILE = re.compile(r"(?P<file>.+\.(?:py|so|dylib|fmu))(?::(?P<name>\w+))?", re.DOTALL)
_MODULE = re.compile(r"(?P<module>\w+(?:\.\w+)+|\w+(?=:))(?::(?P<name>\w+))?")


@cache
def shipped() -> tuple[str, ...]:
    """Names of the laws that come with hertzloop, one file each."""
    files = (f.stem for f in SHIPPED.glob("*.py"))
    return tuple(sorted(name for name in files if not name.startswith("_")))


def known() -> list[str]:
    """Names of all laws that need no file: shipped and of installed packages."""
    return [*shipped(), *sorted(_entry_points())]


@cache
def _entry_points() -> dict[str, str]:
    return {e.name: e.value for e in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def resolve(reference: str, folder: Path | None = None) -> str:
    """A reference with the whole path of its file: in `folder`, else in the working folder. Raises
    LawError for a file's name without its ending."""
    if reference in shipped():  # the cases of a sweep ask again and again
        return reference
    match = _FILE.fullmatch(reference)
    tried = [*([folder] if folder else []), Path.cwd()]
    if not match:
        files = [f"{reference}{ending}" for ending in _ENDINGS]
        there = [file for file in files if any(os.path.isfile(at / file) for at in tried)]
        if there and re.fullmatch(r"\w+", reference) and reference not in known():
            raise LawError(
                f"controller.law = '{reference}': unknown law, but the file {there[0]} exists. "
                f"Give the full file name, controller.law = '{there[0]}'."
            )
        return reference
    found = next((f / match["file"] for f in tried if os.path.isfile(f / match["file"])), None)
    path = (found or tried[-1] / match["file"]).resolve()
    return f"{path}:{match['name']}" if match["name"] else str(path)


def check_one_file(reference: str, folder: Path | None) -> None:
    """Raise LawError if `folder` and the working folder have a file each that a reference means."""
    match = _FILE.fullmatch(reference)
    if not match or folder is None:
        return
    beside, here = folder / match["file"], Path.cwd() / match["file"]
    if beside.is_file() and here.is_file() and not beside.samefile(here):
        raise LawError(
            f"controller.law = '{reference}': means {beside.resolve()}, beside the scene, and "
            f"{here}. Give the whole path of one of them."
        )


def find(reference: str, digest: str | None = None) -> Law:
    """The law that a reference means. Raises LawError; also if it has not the `digest` given, of
    which nothing is executed then."""
    if reference in shipped():
        law = _loaded_shipped(reference)
        check_digest(reference, law.digest, digest)
        return law
    file = _FILE.fullmatch(reference)
    if file:
        return _from_file(reference, Path(file["file"]), file["name"], digest)
    if Path(reference).suffix in _SOURCE:
        library = Path(reference).with_suffix(".so")
        raise LawError(
            f"controller.law = '{reference}': is source code. Run "
            f"`{compilation(Path(reference))}`, then set controller.law = '{library}'."
        )
    installed = _entry_points().get(reference)
    module = _MODULE.fullmatch(installed or reference)
    if module:
        return _from_module(reference, module["module"], module["name"], digest)
    close = difflib.get_close_matches(reference, known(), 1)
    hint = f"Did you mean {close[0]}? " if close else ""
    raise LawError(
        f"controller.law = '{reference}': unknown law. {hint}Use one of {', '.join(known())}, "
        "a file such as mine.py, mine.so or mine.fmu, or package.module:Name."
    )


def read_again() -> None:
    """Have the laws of files and modules read anew when they are next asked for: what they read
    themselves, such as a file of gains, may have changed meanwhile."""
    global _reading
    _reading += 1


def check_digest(law: str, found: str, wanted: str | None) -> None:
    """Raise LawError, which names the `law`, if another digest than that found is wanted."""
    if wanted is not None and not same_law(found, wanted):
        why = "Copy the same file to both sides."
        if found[:TEXT_DIGITS] == wanted[:TEXT_DIGITS] and len(found) == len(wanted):
            why = (
                "Its files are the same, but other values were read when it was imported: from a "
                "file, the environment, another module, random numbers or a clock. Make these the "
                "same on both sides."
            )
        raise LawError(f"law {law}: its digest here is {found}, but {wanted} is required. {why}")


@cache
def _loaded_shipped(name: str) -> Law:
    path = SHIPPED / f"{name}.py"
    home, digest = importlib.import_module(f"hertzloop.controller.laws.{name}"), digest_of(path)
    check_home(name, home)
    return Law(name, path, python_text(path.read_bytes()), digest, home)


@dataclass(frozen=True)
class _Loaded:
    """A law, when its file was written, and at which count of `read_again` it was loaded."""

    law: Law
    stamp: tuple[int, int]
    reading: int


_reading = 0
_loaded: dict[str, _Loaded] = {}  # by reference


def _found(reference: str, path: Path, digest: str | None, load: Callable[[], Law]) -> Law:
    """The law as it was loaded before, where nothing may have changed, or that has the digest."""
    stat = path.stat()
    stamp, kept = (stat.st_mtime_ns, stat.st_size), _loaded.get(reference)
    if (
        kept is None
        or kept.stamp != stamp
        or digest not in (None, kept.law.digest)
        or (digest is None and kept.reading != _reading)
    ):
        kept = _loaded[reference] = _Loaded(load(), stamp, _reading)
    return kept.law


def load_anew(reference: str) -> Law:
    """The law that a reference means, loaded once more. Raises LawError."""
    read_again()
    return find(reference)


def _from_file(reference: str, path: Path, name: str | None, digest: str | None) -> Law:
    path = path if path.is_absolute() else Path.cwd() / path
    try:
        return _found(reference, path, digest, lambda: _load_file(path, name, digest))
    except OSError as error:
        place = "" if reference == str(path) else f"{path} "
        raise LawError(
            f"controller.law = '{reference}': {place}cannot be read: "
            + why_unreadable(path, error, "'hertzloop law new mine.py' writes a law.")
        ) from error


def _load_file(path: Path, name: str | None, digest: str | None) -> Law:
    try:
        found = digest_of(path)
    except (SyntaxError, ValueError) as error:
        raise LawError(f"law {path}: is not valid Python: {error}") from error
    _check_text(str(path), found, digest)
    if path.suffix != ".py":
        check_digest(str(path), found, digest)
        return unit_law(path, found) if path.suffix == ".fmu" else library_law(path, found)
    source = python_text(path.read_bytes())
    module = ModuleType(f"hertzloop_file_{path.stem}_{found}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    folder = str(path.parent)
    added = [] if folder in sys.path else [folder]
    sys.path += added
    try:
        with _loading(str(path), path):
            exec(compile(source, str(path), "exec"), module.__dict__)
    finally:
        for entry in added:
            sys.path.remove(entry)
    label = path.name if not name else f"{path.name}:{name}"
    return _identified(label, module, name, path, source, found, digest)


def _from_module(reference: str, module: str, name: str | None, digest: str | None) -> Law:
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise LawError(f"controller.law = '{reference}': {error}") from error
    if spec is None or not spec.origin or not spec.origin.endswith(".py"):
        raise LawError(
            f"controller.law = '{reference}': the Python module {module} was not found. Install it."
        )
    path = Path(spec.origin)

    def load() -> Law:
        with _loading(reference, path):
            found = digest_of(path)
            _check_text(reference, found, digest)
            home = importlib.import_module(module)
        source = python_text(path.read_bytes())
        return _identified(reference, home, name, path, source, found, digest)

    return _found(reference, path, digest, load)


def _check_text(law: str, text: str, wanted: str | None) -> None:
    """Refuse a law with another text, of which nothing has been executed yet. Raises LawError."""
    if wanted is not None and text[:TEXT_DIGITS] != wanted[:TEXT_DIGITS]:
        check_digest(law, text, wanted)


def _identified(
    label: str,
    module: ModuleType,
    name: str | None,
    path: Path,
    source: str,
    text: str,
    wanted: str | None,
) -> Law:
    home: Any = module
    if name:
        home = getattr(module, name, None)
        if home is None:
            raise LawError(
                f"controller.law: {path} does not define {name}. Define it or change the name."
            )
    check_home(label, home)
    identity = identify(home)
    digest = law_digest(text, identity)
    check_digest(str(path), digest, wanted)
    return Law(label, path, source, digest, home, identity)


@contextmanager
def _loading(law: str, path: Path) -> Iterator[None]:
    """Let code of a law run for a while at most, with what it imports. Raises LawError."""
    try:
        with given_up_in_time(), _own_modules_anew():
            yield
    except LawError:
        raise
    except LawTimeout:
        raise LawError(
            f"law {law}: was not loaded within {callbacks.PATIENCE_S:g} s. Check it for an endless "
            "loop."
        ) from None
    except (Exception, SystemExit) as error:
        raise LawError(f"law {law}: cannot be loaded: {error_text(error, path)}") from error


_own_modules: set[str] = set()  # that laws have imported


@contextmanager
def _own_modules_anew() -> Iterator[None]:
    """Let a law import its own modules anew, from their text. What the process had imported before
    any law did stays as it is: `importlib.reload` reads that again."""
    importlib.invalidate_caches()
    before = {name: sys.modules.pop(name) for name in _own_modules & sys.modules.keys()}
    known, writes = set(sys.modules), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # bytecode does not tell two edits of a second apart
    try:
        yield
    finally:
        sys.dont_write_bytecode = writes
        imported = sys.modules.keys() - known
        _own_modules.update(name for name in imported if _is_own(sys.modules[name]))
        for name, module in before.items():  # laws that were loaded before may still need it
            sys.modules.setdefault(name, module)


_INSTALLED = tuple(
    sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


def _is_own(module: ModuleType) -> bool:
    """Whether a module is neither installed nor part of hertzloop."""
    if module.__name__.partition(".")[0] == "hertzloop":
        return False
    file = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", [])), "")
    return bool(file) and not file.endswith(".so") and not file.startswith(_INSTALLED)


@cache
def shipped_keys() -> dict[str, FieldInfo]:
    """Scene keys of all shipped laws."""
    return {
        name: info
        for law in shipped()
        for name, info in _loaded_shipped(law).keys.model_fields.items()
    }


SHIPPED = Path(__file__).resolve().parent.parent / "laws"  # the laws that come with hertzloop


def compilation(path: Path) -> str:
    """The command that makes a library beside a law's source text in C."""
    compiler = "cc" if path.suffix == ".c" else "c++"
    source, library = shlex.quote(str(path)), shlex.quote(str(path.with_suffix(".so")))
    return f"{compiler} -O2 -fPIC -shared -ffp-contract=off {source} -o {library} -lm"


def digest_of(path: Path) -> str:
    """Digest of a law's file and, for Python, of all files beside it and shipped laws that it
    imports. It is known before any of it is executed.

    Raises OSError, SyntaxError or ValueError.
    """
    total = hashlib.sha256()
    for file in _files(path) if path.suffix == ".py" else [path]:
        content = file.read_bytes()
        total.update(f"{file.name} {len(content)}\n".encode() + content)
    return total.hexdigest()[:32]


def _files(path: Path) -> list[Path]:
    """A file and those of its folder, or shipped ones, that it imports, directly or not."""
    found, open_ = {path}, [path]
    while open_:
        file = open_.pop()
        for name in _imported(ast.parse(python_text(file.read_bytes()), str(file))):
            for folder in (path.parent, SHIPPED):
                used = folder / f"{name}.py"
                if used not in found and used.is_file():
                    found.add(used)
                    open_.append(used)
    return [path, *sorted(found - {path}, key=lambda file: file.name)]


def _imported(tree: ast.Module) -> set[str]:
    """Last words of all imported names: a module of the same folder is among them if at all."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module or "", *(alias.name for alias in node.names)}
    return {name.rpartition(".")[2] for name in names}
